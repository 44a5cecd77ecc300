"""The chain in modelled water, or in air, as the model of a film: outlines by parameters."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from pipeline.formats.bending_states import BendingStates, read
from pipeline.scene.scene import Scene
from pipeline.structure.finger import ElasticFinger
from pipeline.structure.motion import motion
from piv.files.atomic import write_text
from piv.files.errors import StageError
from piv.formats.user_tables import read_history
from postprocess.lab.pose import Pose
from softfinger.twin.film import Film, read_film
from softfinger.twin.fit import BAND, FloatArray, Parameter

STIFF, LOADS, LOSS, MASS, DRAG = (
    "stiffness against pressure", "stiffness against loads over it", "loss factor",
    "added mass of the water", "drag of the water",
)  # fmt: skip
CHAIN = STIFF, LOADS, LOSS, MASS, DRAG  # all others are of the camera and its clock
SCALE, ROOT_X, ROOT_Y, TURN, GROWTH = "scale", "root x", "root y", "turn", "growth of the outline"
TILT_X, TILT_Y, AWAY = "slant along x", "slant along y", "distance of the camera"
SHUTTER = "readout of a picture"  # from its first row to its last
START = "start of {}"  # a film's first picture on the pressure's clock
_STEPS = 100  # of the first vibration; with 60 the tip lags by a pixel
_MOST_STEPS = 1500
_KEPT = 100  # runs in memory, of 2 MB at most; the slopes of four films need half of them
_UNSEEN = 0.1  # of the length, from the root on: the holder may hide it
_CORNER = 0.04  # of the length, to the tip's end: a finger with a width has no sharp corner there
_EVERY = 3  # of the profile's points
_TIP = (0.35, 0.5, 0.65)  # of the thickness: points of the tip's end
_BESIDE = 4  # points from the tip's middle to those of the sides that place it
# standard deviations of the priors; of the root in m
PRIORS = {STIFF: 0.3, LOADS: 0.1, LOSS: 0.7, MASS: 0.15, DRAG: 0.25, SCALE: 0.02}
Motion = tuple[FloatArray, FloatArray]  # times (s) and outlines (time, point, 2) m
ROOT_STD, TURN_STD, GROWTH_STD, START_STD = 1.5e-3, np.radians(1.5), 1.0, 0.02
TILT_STD, AWAY_MEAN, AWAY_STD, SHUTTER_STD = np.radians(5), 0.6, 0.5, 0.01  # rad, m, ratio, s
SMOOTHING = 0.01  # s over which a pressure log is averaged


def scaled(states: BendingStates, stiff: float, loads: float) -> BendingStates:
    """Bending states of a rubber that is `stiff` times as stiff, against loads `loads` times that.

    Exact for one modulus: a shape at the pressure P then needs the pressure `stiff` P.
    """
    if states.law is None:
        raise StageError("the bending states hold no law under loads: analyse them with under_load")
    moment = stiff * loads
    law = replace(
        states.law, stiffness=moment * states.law.stiffness, moment=moment * states.law.moment
    )
    return replace(states, pressure=stiff * states.pressure, law=law)


@dataclass(frozen=True)
class Stroke:
    """A film and the pressure log of its stroke."""

    film: Film
    pressure: Path


@dataclass(frozen=True)
class Twin:
    """A scene's finger as the film's model.

    `pose`: stated; `shape`: rows and columns of the pictures; `air`: filmed in air; `water`: mean
    and relative standard deviation of its coefficients.
    """

    scene: Scene
    pose: Pose
    shape: tuple[int, int]
    air: bool = False
    water: dict[str, tuple[float, float]] = field(
        default_factory=lambda: {name: (1.0, PRIORS[name]) for name in (MASS, DRAG)}
    )

    @cached_property
    def states(self) -> BendingStates:
        """Those of the scene."""
        return read(self.scene.folder / str(self.scene.motion.states))

    @cached_property
    def _runs(self) -> dict[tuple, Motion]:
        return {}

    def parameters(self, names: list[str]) -> list[Parameter]:
        """The parameters of films by their names, with priors."""
        water = {} if self.air else self.water
        loss = self.scene.structure.loss_factor
        return [
            *(Parameter(name, 1.0, PRIORS[name], "", ratio=True) for name in (STIFF, LOADS, SCALE)),
            *(Parameter(name, *prior, "", ratio=True) for name, prior in water.items()),
            Parameter(LOSS, loss, PRIORS[LOSS], "", ratio=True),
            Parameter(ROOT_X, 0.0, ROOT_STD / self.pose.pixel, "px"),
            Parameter(ROOT_Y, 0.0, ROOT_STD / self.pose.pixel, "px"),
            Parameter(TURN, 0.0, TURN_STD, "rad"),
            Parameter(GROWTH, 0.0, GROWTH_STD, "px"),
            *(Parameter(name, 0.0, TILT_STD, "rad") for name in (TILT_X, TILT_Y)),
            Parameter(AWAY, AWAY_MEAN, AWAY_STD, "m", ratio=True),
            Parameter(SHUTTER, 0.0, SHUTTER_STD, "s"),
            *(Parameter(START.format(name), 0.0, START_STD, "s") for name in names),
        ]

    def at_rest(self) -> FloatArray:
        """The finger's outline (point, 2) m in the tank, without pressure and loads."""
        finger = ElasticFinger.of(self.scene, self.states)
        none = np.zeros((1, finger.chain.slices))
        return np.asarray(self.outlines(finger, np.zeros(1), none)[0])

    def run(self, values: dict[str, float], pressure: Path) -> Motion:
        """Times (s) on the pressure's clock and outlines (time, point, 2) m; StageError."""
        key = (pressure, *(round(values.get(n, 1.0), 12) for n in CHAIN))
        if key not in self._runs:
            self._runs[key] = self._computed(values, pressure)
            if len(self._runs) > _KEPT:
                self._runs.pop(next(iter(self._runs)))  # the oldest
        return self._runs[key]

    def _computed(self, values: dict[str, float], pressure: Path) -> Motion:
        first, end = read_history(pressure, "pressure", least=2)[0][[0, -1]]
        moved = {
            "strokes": (), "pressure_csv": str(pressure.resolve()), "end_time": float(end),
            "smoothing": SMOOTHING,
        }  # fmt: skip
        damped = self.scene.structure.model_copy(update={"loss_factor": values[LOSS]})
        moved_scene = self.scene.model_copy(
            update={"motion": self.scene.motion.model_copy(update=moved), "structure": damped}
        )
        states = scaled(self.states, values[STIFF], values[LOADS])
        finger = ElasticFinger.of(moved_scene, states)
        around = finger.air if self.air else finger.model
        around = replace(
            around,
            added_mass=around.added_mass * values.get(MASS, 1.0),
            drag=around.drag * values.get(DRAG, 1.0),
        )
        begin = min(float(first), 0.0)
        step = max(finger.period / _STEPS, (end - begin) / _MOST_STEPS)
        time = np.linspace(begin, end, max(round((end - begin) / step), 10) + 1)
        chambers = finger.chambers(time + 0.5 * SMOOTHING)  # the average lags by half of its span
        none = np.zeros((len(time), finger.chain.slices, 3))
        beyond = max(states.pressure[0] - chambers.min(), chambers.max() - states.pressure[-1])
        if beyond > 0.01 * np.ptp(states.pressure):
            raise StageError(self._softer(pressure, values[STIFF], chambers))
        step = float(time[1] - time[0])
        turned = motion(finger.chain, chambers, step, around, none, most=np.inf)
        return time, self.outlines(finger, chambers, turned)

    def _softer(self, pressure: Path, stiff: float, chambers: FloatArray) -> str:
        """What to analyse where the states end before the pressures of a rubber `stiff` times."""
        softest = float(np.exp(-BAND * PRIORS[STIFF]))
        step = float(np.median(np.diff(self.states.pressure)))
        low = min(chambers.min() / softest, self.states.pressure[0]) / step
        high = max(chambers.max() / softest, self.states.pressure[-1]) / step
        return (
            f"{pressure}: the fit tries a rubber {stiff:.2f} times as stiff, for which the bending"
            f" states do not reach the pressures; in {self.scene.folder / 'scene.toml'} write"
            f" fea.first_pressure_kpa = {np.floor(low) * step / 1e3:g} and fea.last_pressure_kpa ="
            f" {np.ceil(high) * step / 1e3:g}, for one {softest:.2f} times as stiff, then make fea"
        )

    def outlines(
        self, finger: ElasticFinger, chambers: FloatArray, turned: FloatArray
    ) -> FloatArray:
        """Points (time, point, 2) m along the ventral side, around the tip and back."""
        line = finger.chain.profile(chambers, turned) @ [1, 1j]
        thick = finger.chain.thickness(chambers)
        along = np.gradient(line, axis=1)
        dorsal = line - 1j * thick * along / np.abs(along)
        first = int(_UNSEEN * line.shape[1])
        piece = finger.chain.arc[-1] / (line.shape[1] - 1)
        round_ = self.scene.finger.tip.corner_radius + _CORNER * finger.chain.arc[-1]
        last = -1 - int(np.ceil(round_ / piece))
        tip = np.stack([(1 - w) * line[:, -1] + w * dorsal[:, -1] for w in _TIP], axis=1)
        sides = line[:, first:last:_EVERY], tip, dorsal[:, first:last:_EVERY][:, ::-1]
        points = np.concatenate(sides, axis=1)
        edge = -0.5j * finger.chain.thickness(np.zeros(1))[0, 0]
        local = np.stack([(points - edge).real, (points - edge).imag], axis=-1)
        return np.asarray(local @ finger.frame + finger.root)

    def pose_of(self, values: dict[str, float]) -> Pose:
        """The camera's pose by its parameters."""
        return replace(
            self.pose,
            scale_mm_per_px=self.pose.scale_mm_per_px * values[SCALE],
            angle=self.pose.angle + values[TURN],
            at_px=(self.pose.at_px[0] + values[ROOT_X], self.pose.at_px[1] + values[ROOT_Y]),
        )

    def posed(self, values: dict[str, float], outlines: FloatArray) -> FloatArray:
        """Outlines (time, point, 2) m in the pictures, px with y up, as the camera sees them."""
        centre, slant, far = self._lens(values)
        away = (self.pose_of(values).to_px(outlines) - centre) * np.cos(slant)
        away = away / (1 + away @ np.tan(slant) / far)[..., None]
        across = outward(away)
        # of the finger's width the nearer edge or the farther one bounds the silhouette
        width = 0.5 * self.scene.finger.width / values[AWAY]
        grown = width * np.abs(np.sum((away + far * np.sin(slant)) * across, axis=-1))
        return np.asarray(centre + away + (values[GROWTH] + grown)[..., None] * across)

    def _lens(self, values: dict[str, float]) -> tuple[FloatArray, FloatArray, float]:
        """The picture's centre (2,) px, the camera's slant (2,) rad, and its distance in px."""
        slant = np.array([values[TILT_X], values[TILT_Y]])
        return 0.5 * np.array(self.shape[::-1]), slant, values[AWAY] / self.pose.pixel

    def to_tank(self, values: dict[str, float], seen: FloatArray) -> FloatArray:
        """Places (…, 2) m in the tank of places in the pictures, px with y up."""
        centre, slant, far = self._lens(values)
        away = (seen - centre) / (1 - (seen - centre) @ np.tan(slant) / far)[..., None]
        return self.pose_of(values).to_tank(away / np.cos(slant) + centre)

    def at_pictures(
        self, values: dict[str, float], stroke: Stroke, motion: Motion | None = None
    ) -> FloatArray:
        """Outlines (frame, point, 2) m at the film's pictures, each point when its row is read.

        `motion`: another than the model's.
        """
        time, outlines = motion or self.run(values, stroke.pressure)
        middle = (stroke.film.times + values[START.format(stroke.film.name)])[:, None]
        late, points = np.zeros_like(middle), np.arange(outlines.shape[1])
        for _ in range(2):  # where a point is tells its row, which tells when it is read
            at = np.clip(middle + late, time[0], time[-1])
            k = np.clip(np.searchsorted(time, at) - 1, 0, len(time) - 2)
            w = ((at - time[k]) / (time[k + 1] - time[k]))[..., None]
            placed = (1 - w) * outlines[k, points] + w * outlines[k + 1, points]
            rows = self.pose_of(values).to_px(placed)[..., 1] / self.shape[0]
            late = values[SHUTTER] * (0.5 - rows)
        return np.asarray(placed)

    def seen(self, values: dict[str, float], stroke: Stroke) -> FloatArray:
        """Outlines (frame, point, 2) px at the film's pictures."""
        return self.posed(values, self.at_pictures(values, stroke))

    def residuals(self, values: dict[str, float], strokes: list[Stroke]) -> list[FloatArray]:
        """Of each film the distances (frame, point) px of the predicted from the seen outline."""
        return [stroke.film.at(self.seen(values, stroke)) for stroke in strokes]

    def seen_tips(
        self, values: dict[str, float], stroke: Stroke, motion: Motion | None = None
    ) -> FloatArray:
        """Tip (frame, 2) m that each picture shows: the predicted one, moved to the silhouette.

        To first order, by the distances of the silhouette from the end and from both sides there.
        """
        placed = self.at_pictures(values, stroke, motion)
        outlines = self.posed(values, placed)
        off = stroke.film.at(outlines)[..., None]
        middle = outlines.shape[1] // 2
        one, other = middle - _BESIDE, middle + _BESIDE  # on the ventral and on the dorsal side
        along, across = direction(outlines), outlines[:, one] - outlines[:, other]
        across = across / np.hypot(*across.T)[:, None]
        short, aside = off[:, middle - 1 : middle + 2].mean(axis=1), off[:, one] - off[:, other]
        moved = outlines[:, middle] - short * along - 0.5 * aside * across
        change = self.to_tank(values, moved) - self.to_tank(values, outlines[:, middle])
        return tip_of(placed) + change


def read_stroke(twin: Twin, path: Path, log: Path, rate: float | None) -> Stroke:
    """A film until its pressure ends. StageError where the two have no time in common."""
    times, _ = read_history(log, "pressure", least=2)
    first, last = float(times[0]), float(times[-1])
    film = read_film(path, rate, twin.pose, twin.at_rest(), max(last, 0.0))
    if last <= 0 or first >= film.times[-1]:
        raise StageError(
            f"{log}: has times from {first:g} to {last:g} s, {path} from 0 to {film.times[-1]:g} s;"
            " the film begins at t = 0 of its pressure: correct the times, or --rate"
        )
    return Stroke(film, log)


def write_log(path: Path, times: FloatArray, pressures: FloatArray) -> None:
    """Write a pressure's log; times (s) keep nine digits, so that those of a long one differ."""
    rows = (f"{t:.9g},{p:.6g}" for t, p in zip(times, pressures, strict=True))
    write_text(path, "\n".join(["t,p", *rows, ""]))


def tip_of(outlines: FloatArray) -> FloatArray:
    """The middle of the tip's end (…, 2) of outlines (…, point, 2)."""
    return np.asarray(outlines[..., outlines.shape[-2] // 2, :])


def direction(outlines: FloatArray) -> FloatArray:
    """Unit vectors (time, 2) out of the tip, along the finger."""
    middle = outlines.shape[1] // 2
    sides = outlines[:, [middle - _BESIDE, middle + _BESIDE]].mean(axis=1)
    along = outlines[:, middle] - sides
    return np.asarray(along / np.hypot(*along.T)[:, None])


def outward(outlines: FloatArray) -> FloatArray:
    """Unit normals (time, point, 2) out of outlines (time, point, 2): of sides and tip each."""
    middle = outlines.shape[1] // 2
    parts = np.split(outlines, [middle - len(_TIP) // 2, middle + len(_TIP) // 2 + 1], axis=1)
    along = np.concatenate([np.gradient(part, axis=1) for part in parts], axis=1)
    across = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    across /= np.maximum(np.hypot(*np.moveaxis(across, -1, 0)), 1e-9)[..., None]
    side = np.sum(across[:, 0] * (outlines[:, 0] - outlines[:, -1]), axis=-1)
    return np.asarray(np.sign(side)[:, None, None] * across)
