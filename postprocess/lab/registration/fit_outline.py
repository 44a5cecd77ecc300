"""One pose and one law of motion fitted to the finger's outline in many frames at once.

The likelihood of `silhouette` has a bump per particle and long narrow ridges. A population of
chains begins far apart and is cooled into it; chains that fare worse are replaced by copies of
better ones (Hukushima and Iba 2003). Steps are differences of other chains (ter Braak 2006). The
mean of the samples is the estimate: an edge lies half-way between the particles that bound it.
Fitting the law to all silhouettes, not to one bend per frame, uses every particle near an edge.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np

from fileio.errors import StageError
from fileio.formats.kinematics import Kinematics, counter_clockwise
from postprocess.lab.data.pose import Pose
from postprocess.lab.registration.silhouette import (
    FINE_PX,
    WaterLikelihood,
    integral_image,
    left_of,
)

# state of a chain: x px, y px, angle, ln magnification (px per m), growth of the outline px, and
# factor, delay s, stretch
SIZE, GROWTH, LAW, DELAY, FACTORS = 8, 4, slice(5, 8), 6, [5, 7]
TABLE = 241  # shapes in the table that outlines are interpolated from
REACH = 0.15  # of the simulation's range: how far a recording may bend beyond the simulation
LAW_POINTS = 2001  # of the law's own table
COLD = 2e-3  # share of the evidence at the beginning
HALF, EFFECTIVE = 14, 0.5  # chains in each half, and the share of them that a step of heat leaves
LEAST, OUTSIDE = 0.05, -1e9  # stretch, and evidence beyond the table
# range of a single frame's bend, in standard deviations, and its step, in the table's
FAR_OFF, FINE_STEP = 4.0, 0.1
# rest of the law: spread of factor, delay (s) and stretch at the start
LAW_ABOUT = np.array([0.02, 3e-3, 0.02])


@dataclass(frozen=True)
class Frames:
    """`integral_image` of the frames' evidence (frame, …) less its `mean`, and times (s)."""

    integrals: np.ndarray
    mean: float
    times: np.ndarray
    independent: float  # share of independent frames: particles at rest stay where they are


def prepare(
    images: list[np.ndarray],
    times: np.ndarray,
    evidence: WaterLikelihood,
    blind: np.ndarray | None = None,
    blur_px: float = FINE_PX,
) -> Frames:
    """Evidence of frames taken at `times` (s); `blind` (frame, rows, columns): pixels left out."""
    seen = [evidence.image(image, blur_px) for image in images]
    if blind is not None:
        seen = [np.where(b, np.float32(0), f) for b, f in zip(blind, seen, strict=True)]
    few = [f.ravel()[::3] for f in seen]
    near = [np.corrcoef(a, b)[0, 1] for a, b in itertools.pairwise(few)]
    common = float(np.clip(np.mean(near), 0, 0.99)) if near else 0.0
    mean = float(np.mean([f.mean() for f in seen]))
    integrals = np.stack([integral_image(f, mean).astype(np.float32) for f in seen])
    return Frames(integrals, mean, np.asarray(times, float), (1 - common) / (1 + common))


@dataclass(frozen=True)
class Shapes:
    """The finger's outlines in a table of pressures, and the simulation's law.

    `pressures` (n,) Pa, `outlines` (n, point, 2) m, `normals` (n, point, 2): outward unit normals.
    A *place* is an index into the table, fractional.
    """

    kinematics: Kinematics
    pressures: np.ndarray
    outlines: np.ndarray
    normals: np.ndarray

    @property
    def step(self) -> float:
        """Pressure (Pa) between two places."""
        return float(self.pressures[1] - self.pressures[0])

    @property
    def rest(self) -> int:
        """Place of the finger at rest, to the next whole one."""
        start = self.kinematics.law(self.kinematics.time[0])
        return int(np.argmin(np.abs(self.pressures - start)))

    @cached_property
    def _history(self) -> tuple[np.ndarray, np.ndarray]:
        clock = np.linspace(*self.kinematics.time, LAW_POINTS)
        return clock, self.places_of(self.kinematics.law(clock))

    def places_of(self, pressures: np.ndarray) -> np.ndarray:
        """Places of pressures (Pa)."""
        return (np.asarray(pressures) - self.pressures[0]) / self.step

    def thinned(self, every: int) -> Shapes:
        """One of `every` points of the outlines."""
        few = (np.ascontiguousarray(a[:, ::every]) for a in (self.outlines, self.normals))
        return Shapes(self.kinematics, self.pressures, *few)

    def mirrored(self) -> Shapes:
        """Of a finger that bends to the other side of the vertical through its root."""
        flip, root = np.array([-1.0, 1.0]), np.asarray(self.kinematics.root)
        turned = (self.outlines[:, ::-1] - root) * flip + root, self.normals[:, ::-1] * flip
        return Shapes(self.kinematics, self.pressures, *map(np.ascontiguousarray, turned))

    def places(self, times: np.ndarray, laws: np.ndarray) -> np.ndarray:
        """Places (chain, frame) by start + factor (law((t - delay)/stretch) - start)."""
        factor, delay, stretch = laws.T[:, :, None]
        clock, history = self._history
        at = np.interp((times - delay) / np.maximum(stretch, LEAST), clock, history)
        return history[0] + factor * (at - history[0])

    def scores(self, frames: Frames, states: np.ndarray, off: np.ndarray | float) -> np.ndarray:
        """Evidence (chain, frame) of states (chain, 8), with places `off` the law's.

        `OUTSIDE` where a place is beyond the table.
        """
        at = self.places(frames.times, states[:, LAW]) + off
        seen = self.scores_at(frames, states, np.clip(at, 0, TABLE - 1))
        return np.where((at >= 0) & (at <= TABLE - 1), seen, OUTSIDE)

    def scores_at(self, frames: Frames, states: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Evidence (chain, frame) of states (chain, 8) at `places` (chain, frame)."""
        root = np.asarray(self.kinematics.root)
        evidence = frames.integrals, frames.mean, self.outlines, self.normals, root
        return np.asarray(_scores(*evidence, np.ascontiguousarray(states[:, :5]), places))


def shapes_of(kinematics: Kinematics) -> Shapes:
    """The table of a motion."""
    reach = REACH * (kinematics.high - kinematics.low)
    pressures = np.linspace(kinematics.low - reach, kinematics.high + reach, TABLE)
    outlines = np.array([counter_clockwise(o) for o in kinematics.shape("outline", pressures)])
    along = np.roll(outlines, -1, axis=-2) - np.roll(outlines, 1, axis=-2)
    normals = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    normals /= np.maximum(np.hypot(normals[..., 0], normals[..., 1]), 1e-12)[..., None]
    return Shapes(kinematics, pressures, outlines, normals)


@numba.njit(cache=True)
def _scores(integrals, mean, outlines, normals, anchor, seats, places):
    """Evidence (chain, frame) inside the outlines at `places` in frames, with y up.

    `integrals` and `mean` as of `silhouette.integral_image`; `seats` (chain, 5): x and y (px) of
    `anchor` (m), angle, ln magnification and growth; `normals` as of `Shapes`.
    """
    points = outlines.shape[1]
    out = np.empty(places.shape)
    for chain in range(places.shape[0]):
        x0, y0, angle, ln_magnification, grown = seats[chain]
        magnification = np.exp(ln_magnification)
        c, s = np.cos(angle), np.sin(angle)
        for f in range(places.shape[1]):
            t = min(max(int(places[chain, f]), 0), outlines.shape[0] - 2)
            w = places[chain, f] - t
            total = px = py = 0.0
            for k in range(points + 1):
                m = k if k < points else 0
                x = (1 - w) * outlines[t, m, 0] + w * outlines[t + 1, m, 0] - anchor[0]
                y = (1 - w) * outlines[t, m, 1] + w * outlines[t + 1, m, 1] - anchor[1]
                nx, ny = normals[t, m, 0], normals[t, m, 1]
                qx = x0 + magnification * (c * x - s * y) + grown * (c * nx - s * ny)
                qy = y0 + magnification * (s * x + c * y) + grown * (s * nx + c * ny)
                if k > 0:
                    total += left_of(integrals[f], mean, px, py, qx, qy)
                px, py = qx, qy
            out[chain, f] = total
    return out


def state_of(pose: Pose, law: np.ndarray) -> np.ndarray:
    """The state (8,) of a pose and a law, with the outline as it is."""
    return np.array([*pose.at_px, pose.angle, -np.log(pose.pixel), 0.0, *law])


def pose_of(state: np.ndarray, anchor: tuple[float, float]) -> Pose:
    """The pose of a state (8,)."""
    x, y, angle, ln_magnification = (float(v) for v in state[:4])
    return Pose(1e3 * float(np.exp(-ln_magnification)), angle, anchor, (x, y))


@dataclass(frozen=True)
class OutlineFit:
    """Samples of the posterior: `states` (sample, 8), `pressures` (sample, frame) Pa."""

    states: np.ndarray
    pressures: np.ndarray
    anchor: tuple[float, float]

    @property
    def state(self) -> np.ndarray:
        """The middle of the samples, (8,)."""
        return np.asarray(self.states.mean(axis=0))

    @property
    def seen(self) -> tuple[Pose, np.ndarray, float]:
        """Pose, pressures (frame,) Pa, and growth of the outline (px): mean values."""
        return (
            pose_of(self.state, self.anchor),
            self.pressures.mean(axis=0),
            float(self.state[GROWTH]),
        )


@dataclass
class _Population:
    """Two halves of chains with their states and each frame's deviation from the law's place.

    Each half moves by differences of the other's. Besides joint steps the law takes steps under
    places that stay, which only the deviations follow (interweaving, Yu and Meng 2011).
    """

    frames: Frames
    shapes: Shapes
    prior: tuple[np.ndarray, np.ndarray]  # mean and standard deviation (8,)
    apart: np.ndarray  # standard deviation (frame,) of a place from the law's
    states: np.ndarray
    off: np.ndarray
    rng: np.random.Generator

    def __post_init__(self) -> None:
        self.scores = self.shapes.scores(self.frames, self.states, self.off)
        self.jitter = 1e-3 * self.states.std(axis=0)

    def sweep(self, heat: float) -> None:
        """One step of each kind of every chain; `heat`: share of the evidence that counts."""
        share = heat * self.frames.independent
        for mine, other in ((slice(HALF), slice(HALF, None)), (slice(HALF, None), slice(HALF))):
            states, off, scores = self.states[mine], self.off[mine], self.scores[mine]
            tried = states + self._differences(self.states[other], SIZE)
            new = self.shapes.scores(self.frames, tried, off)
            gain = share * (new - scores).sum(axis=1) + self._prior(tried) - self._prior(states)
            _take(self._likely(gain), (states, tried), (scores, new))
            tried = states.copy()
            tried[:, LAW] += self._differences(self.states[other], 3)[:, LAW]
            at = self.shapes.places(self.frames.times, states[:, LAW]) + off
            new_off = at - self.shapes.places(self.frames.times, tried[:, LAW])
            gain = self._loose(new_off).sum(axis=1) - self._loose(off).sum(axis=1)
            gain += self._prior(tried) - self._prior(states)
            _take(self._likely(gain), (states, tried), (off, new_off))
            new_off = off + self._differences(self.off[other], 1, 0.02 * self.apart)
            new = self.shapes.scores(self.frames, states, new_off)
            gain = share * (new - scores) + self._loose(new_off) - self._loose(off)
            _take(self._likely(gain), (off, new_off), (scores, new))

    def resample(self, shares: np.ndarray) -> None:
        """Replace chains by copies of better ones, by their `shares`."""
        at = (self.rng.random() + np.arange(2 * HALF)) / (2 * HALF) * shares.sum()
        left = self.rng.permutation(
            np.minimum(np.searchsorted(np.cumsum(shares), at), 2 * HALF - 1)
        )
        self.states, self.off, self.scores = (a[left] for a in (self.states, self.off, self.scores))

    def _differences(
        self, others: np.ndarray, count: int, jitter: np.ndarray | None = None
    ) -> np.ndarray:
        """Steps (chain, …) in `count` dimensions."""
        one = self.rng.integers(HALF, size=HALF)
        two = (one + self.rng.integers(1, HALF, size=HALF)) % HALF
        noise = self.rng.standard_normal((HALF, others.shape[1]))
        step = 2.38 / np.sqrt(2 * count) * (others[one] - others[two])
        return np.asarray(step + noise * (self.jitter if jitter is None else jitter))

    def _prior(self, states: np.ndarray) -> np.ndarray:
        mean, std = self.prior
        return np.asarray(-0.5 * np.sum(((states - mean) / std) ** 2, axis=1))

    def _loose(self, off: np.ndarray) -> np.ndarray:
        return np.asarray(-0.5 * (off / self.apart) ** 2)

    def _likely(self, gain: np.ndarray) -> np.ndarray:
        return np.asarray(np.log(self.rng.random(gain.shape)) < gain)


def _take(accepted: np.ndarray, *pairs: tuple[np.ndarray, np.ndarray]) -> None:
    for old, new in pairs:
        old[accepted] = new[accepted]


def _next_heat(evidence: np.ndarray, heat: float) -> tuple[float, np.ndarray]:
    """The next share of the evidence (chain,) to count, at most 1, and the chains' weights.

    The weights keep at least `EFFECTIVE` of the chains.
    """
    for share in np.geomspace(2.0, 1.02, 20):
        new = min(heat * share, 1.0)
        weight = np.exp((new - heat) * (evidence - evidence.max()))
        weight /= weight.sum()
        if 1 / np.sum(weight**2) >= EFFECTIVE * evidence.size:
            break
    return new, weight


def fit_outline(
    frames: Frames,
    shapes: Shapes,
    first: np.ndarray,
    about: np.ndarray,
    prior: tuple[np.ndarray, np.ndarray],
    deviation: np.ndarray,
    sweeps: tuple[int, int],
    seed: int = 1,
) -> OutlineFit:
    """Fit pose, law and pressures from a first state (8,), known to `about` (8,).

    `prior`: mean and standard deviation (8,; inf: none). `deviation` (frame,) Pa: of a frame from
    the law. `sweeps`: at each heat, and those that are kept. ValueError where the recording's
    finger bends further than the simulation's shapes reach.
    """
    rng = np.random.default_rng(seed)
    states = first + about * rng.standard_normal((2 * HALF, SIZE))
    states[0], apart = first, np.asarray(deviation, float) / shapes.step
    off = 0.3 * np.minimum(apart, 1.0) * rng.standard_normal((2 * HALF, apart.size))
    chains = _Population(frames, shapes, prior, apart, states, off, rng)
    heat = COLD
    while heat < 1:
        for _ in range(sweeps[0]):
            chains.sweep(heat)
        heat, shares = _next_heat(frames.independent * chains.scores.sum(axis=1), heat)
        chains.resample(shares)
    kept, places = [], []
    for k in range(sweeps[1] + sweeps[1] // 2):
        chains.sweep(1.0)
        if k >= sweeps[1] // 2:
            kept.append(chains.states.copy())
            places.append(shapes.places(frames.times, chains.states[:, LAW]) + chains.off)
    at = np.concatenate(places)
    middle = at.mean(axis=0)
    if middle.min() < 1 or middle.max() > TABLE - 2:
        raise StageError(
            f"the recording's finger bends further than the simulation's by more than {REACH:.0%};"
            " give the simulation the recording's pressure (motion.strokes in scene.toml)"
        )
    pressures = shapes.pressures[0] + shapes.step * at
    return OutlineFit(np.concatenate(kept), pressures, shapes.kinematics.root)


def single_pressures(
    frames: Frames, shapes: Shapes, state: np.ndarray, law: np.ndarray, deviation: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pressure of each frame (frame,) by itself at a state (8,), and its standard deviation.

    By integration over a prior about `law` (frame,) of size `deviation`; all in Pa.
    """
    off = np.arange(-FAR_OFF, FAR_OFF, FINE_STEP / deviation * shapes.step)[:, None]
    tried = np.clip(law + off * deviation, shapes.pressures[0], shapes.pressures[-1])
    states = np.broadcast_to(state, (off.size, SIZE))
    score = frames.independent * shapes.scores_at(frames, states, shapes.places_of(tried))
    weight = score - 0.5 * off**2
    weight = np.exp(weight - weight.max(axis=0))
    weight /= weight.sum(axis=0)
    mean = (weight * tried).sum(axis=0)
    return mean, np.sqrt((weight * (tried - mean) ** 2).sum(axis=0))
