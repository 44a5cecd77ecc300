"""The finger's motion, simulated and recorded, and what other runs change of it.

Bend and duration are quantities of the comparison; the flow is judged at the recording's motion.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from pipeline.formats.kinematics import SHAPE, Kinematics
from piv.files.errors import StageError
from piv.formats.plane_series import usable
from postprocess.lab.fit_outline import REACH, law_pressure
from postprocess.lab.inputs_toml import Finer, Input
from postprocess.lab.register import Registration
from postprocess.lab.validation import POSTERIOR, Source, ValidatedQuantity
from postprocess.lab.virtual_experiment import Sides

QUANTITIES = (
    ("final_bend", "bend angle at the end", "rad"),
    ("duration", "duration of the stroke", "s"),
)
PARTS = (0.05, 0.95)  # of the bend: between them the stroke lasts
# Ratio, either way, from which a stated rate or interval is wrong: sound recordings of a stroke 6 %
# shorter than the simulation's have 0.84 (docs/record/laboratory.md, four seeds).
CLEARLY = 1.25
AT_PRESSURE = 0.015  # standard uncertainty of a coupled run at a measured pressure, of its values
TABLE = 301  # shapes among which the nearest is sought
BACK = 0.05  # of the largest bend, to the other side: beyond its shapes they go on straight
APART = 0.01  # of the largest bend: between two shapes of a coupled motion
STEP = 1e-3  # s, over which the outline's velocity is taken


@dataclass(frozen=True)
class Effect:
    """What one run beside the nominal one changes.

    `bend` (rad) and `duration` (s): of the motion. `table`: change of `flow.COLUMNS` at each
    instant; None where the flow is not compared. `share` of the change by which the recording's
    motion differs, and its `share_std` by the registration; None where this is not known.
    """

    of: Input | Finer
    bend: float
    duration: float
    table: pd.DataFrame | None = None
    share: float | None = None
    share_std: float = 0.0

    def moves(self, columns: tuple[str, ...], rows: np.ndarray) -> np.ndarray:
        """Mean change of `columns` over the instants `rows`, (component,)."""
        assert self.table is not None
        return self.table.loc[rows, list(columns)].mean().to_numpy(float)

    def std(self, columns: tuple[str, ...], rows: np.ndarray) -> np.ndarray:
        """Standard uncertainty of the mean of `columns` over the instants `rows`, (component,).

        By the change's RMS: where its sign changes, its mean is no small error.
        """
        assert self.table is not None
        change = self.table.loc[rows, list(columns)].to_numpy(float)
        return self.of.per_change * np.sqrt(np.mean(change**2, axis=0))


@dataclass(frozen=True)
class Case:
    """Motions of both sides, their flows (None: not compared), and the effects of the runs."""

    kinematics: Kinematics
    registration: Registration
    bend_std: float  # rad, of the FEA at the end of the stroke; 0: its bands do not count
    flow: Sides | None = None
    effects: list[Effect] = field(default_factory=list)
    at_pressure: tuple[float, float] | None = None  # `difference` of a run at that measured
    no_flow: str = ""  # why it is not compared

    @property
    def finer(self) -> list[Effect]:
        """The runs of finer numerics: what they change is added to the simulation."""
        return [e for e in self.effects if e.of.kind == "numerical"]

    @property
    def of_motion(self) -> list[Effect]:
        """The runs that tell what the recording's own motion changes."""
        return [e for e in self.effects if e.share is not None]


def final_bend(kinematics: Kinematics, factor: float = 1.0) -> float:
    """Bend angle (rad) at the end of the simulation's law, its change multiplied by a factor."""
    start, end = (float(kinematics.law(t)) for t in kinematics.time)
    return float(kinematics.shape("bend", start + factor * (end - start)))


def stroke_duration(kinematics: Kinematics) -> float:
    """Time (s) from 5 to 95 % of the simulation's change of bend."""
    times = np.linspace(*kinematics.time, 801)
    bend = kinematics.bend(kinematics.law(times))
    done = np.maximum.accumulate(np.abs(bend - bend[0])) / np.abs(bend - bend[0]).max()
    first, last = (float(times[np.argmax(done >= part)]) for part in PARTS)
    return last - first


def along_bend(motion: Kinematics) -> Kinematics:
    """A motion whose shapes are known over time, as a coupled one's, with shapes over its bend.

    The parameter is the angle (rad) by which the finger has bent. The shapes are those of the way
    to the largest bend; at each instant the law names that which is nearest in its outline, as the
    registration does. On the way it is the very shape, while the finger swings back another.
    StageError for a finger that bends to both sides.
    """
    bend = motion.data["shape_bend"].values
    angle = (bend - bend[0]) * np.sign(bend[np.argmax(np.abs(bend - bend[0]))] - bend[0])
    if angle.min() < -BACK * angle.max():
        raise StageError(
            "COUPLED=1 compares a finger that bends to one side, and this one bends to both; cut"
            " the scene's strokes and the recording"
        )
    reached = np.maximum.accumulate(np.concatenate([[-np.inf], angle[:-1]]))
    way, last = [0], 0.0
    for k in np.flatnonzero(angle > reached):
        if angle[k] >= last + APART * angle.max():
            way.append(int(k))
            last = angle[k]
    data = motion.data.isel({SHAPE: way}).assign_coords({SHAPE: angle[way]})
    splines = {
        name: CubicSpline(angle[way], of_time(of_time.x[way]))
        for name, of_time in motion.splines.items()
    }
    table, times = np.linspace(0.0, angle[way[-1]], TABLE), motion.law.x
    outlines = splines["outline"](table)
    nearest = [_nearest(table, outlines, motion.shape("outline", motion.law(t))) for t in times]
    return replace(motion, data=data, law=CubicSpline(times, nearest), splines=splines)


def _nearest(values: np.ndarray, outlines: np.ndarray, own: np.ndarray) -> float:
    """The value whose outline (point, 2) is nearest to `own`, across it, to second order."""
    along = np.roll(own, -1, axis=0) - np.roll(own, 1, axis=0)
    across = (outlines - own) @ np.array([[0.0, -1.0], [1.0, 0.0]]) * along
    square = np.mean((across.sum(axis=-1) / np.hypot(*along.T)) ** 2, axis=-1)
    k = min(max(int(np.argmin(square)), 1), len(values) - 2)
    low, middle, high = square[k - 1 : k + 2]
    part = np.clip(0.5 * (low - high) / (low - 2 * middle + high), -1.0, 1.0)
    return float(values[k] + part * (values[1] - values[0]))


def difference(nominal: Kinematics, other: Kinematics) -> tuple[float, float]:
    """By how much final bend (rad) and duration (s) of another motion exceed the nominal ones.

    Those of the nominal law, shifted and stretched, whose shapes are nearest to the other's.
    """
    times, span = np.linspace(*nominal.time, 101), nominal.high - nominal.low
    table = np.linspace(nominal.low - REACH * span, nominal.high + REACH * span, TABLE)
    outlines = nominal.shape("outline", table)
    shapes = other.shape("outline", other.law(np.clip(times, *other.time)))
    wanted = np.array([_nearest(table, outlines, shape) for shape in shapes])
    fit = least_squares(
        lambda values: (law_pressure(nominal, times, values) - wanted) / span,
        (1.0, 0.0, 1.0),
        x_scale=(0.01, 0.001, 0.01),
    )
    factor, _, stretch = (float(value) for value in fit.x)
    bend = final_bend(nominal, factor) - final_bend(nominal)
    return bend, stroke_duration(nominal) * (stretch - 1)


def _motions(case: Case) -> np.ndarray:
    """Final bend (rad) and duration (s): simulated, recorded, standard uncertainty; (2, 3)."""
    law, kinematics = case.registration.law, case.kinematics
    factor, _, stretch = law.values
    seen, lasts = final_bend(kinematics, factor), stroke_duration(kinematics)
    slope = abs(final_bend(kinematics, factor + 0.01) - seen) / 0.01
    return np.array(
        [
            [final_bend(kinematics), seen, slope * law.std("factor")],
            [lasts, lasts * stretch, lasts * law.std("stretch")],
        ]
    )


def at_recorded_motion(case: Case) -> Case:
    """The case with the recording's bend and duration in changes of the runs of pressure and time.

    The flow goes with the bend, and with the speed, the inverse of the duration. As it is where the
    motion was not seen, or those runs were not made.
    """
    named = {e.of.name: e for e in case.effects}
    if case.registration.times.size == 0 or not {"pressure", "duration"} <= set(named):
        return case
    (bend, bend_seen, bend_std), (lasts, lasts_seen, lasts_std) = _motions(case)
    slower = lasts / (lasts + named["duration"].duration) - 1
    for name, seen, std, change in (
        ("pressure", bend_seen - bend, bend_std, named["pressure"].bend),
        ("duration", lasts / lasts_seen - 1, lasts * lasts_std / lasts_seen**2, slower),
    ):
        named[name] = replace(named[name], share=seen / change, share_std=std / abs(change))
    return replace(case, effects=list(named.values()))


def motion_quantities(
    case: Case, moved: tuple[float, float] = (0.0, 0.0)
) -> list[ValidatedQuantity]:
    """Final bend angle and duration of the stroke; none where the recording does not show them.

    Of a simulation whose motion is `moved` by a `difference`.
    """
    if case.registration.times.size == 0:
        return []
    inputs, out = [e for e in case.effects if e.of.kind == "input"], []
    motions = zip(QUANTITIES, _motions(case), moved, strict=True)
    for (name, label, unit), (simulated, seen, std), more in motions:
        sources = [Source("silhouette", "data", np.array([std]), POSTERIOR)]
        for e in inputs:
            change = e.bend if name == "final_bend" else e.duration
            part = np.array([abs(change) * e.of.per_change])
            sources.append(Source(e.of.name, "input", part, e.of.how))
        if case.bend_std and name == "final_bend":
            band = np.array([case.bend_std])
            sources.append(Source("geometry and material", "input", band, "FEA's band"))
        if any(moved):
            part = np.array([AT_PRESSURE * seen])
            sources.append(Source("sensor and coupled run", "input", part, "assumed"))
        both = np.array([simulated + more]), np.array([seen])
        out.append(ValidatedQuantity(name, label, unit, *both, abs(float(seen)), sources))
    return out


def clock_ratio(case: Case, sides: Sides) -> float:
    """Speed of the recording's water within a window of the finger over that of its silhouettes.

    Relative to the same of the virtual experiment, in which boundary layer and window are alike.
    Of vectors that both have beside both fingers: where these lie apart, one hides the other's.
    """
    law, planes = case.registration.law.values, (sides.data, sides.virtual)
    grid = np.stack(np.meshgrid(sides.data["x"].values, sides.data["y"].values), axis=-1)
    beside = np.logical_and(*(usable(plane).values for plane in planes))
    walls = []
    for plane, values in zip(planes, (law, np.array([1.0, law[1], 1.0])), strict=True):
        ends = plane["time"].values + law[1] + STEP * np.array([[-0.5], [0.0], [0.5]])
        shapes = case.kinematics.shape("outline", law_pressure(case.kinematics, ends, values))
        before, now, after = case.registration.pose.to_camera(shapes)
        found = [cKDTree(outline).query(grid) for outline in now]
        beside &= np.array([away for away, _ in found]) < sides.window_m
        speed = zip((after - before) / STEP, found, strict=True)
        walls.append(np.array([each[nearest] for each, (_, nearest) in speed]))
    slopes = []
    for plane, wall in zip(planes, walls, strict=True):
        water = np.stack([plane["u"].values, plane["v"].values], axis=-1)[beside]
        slopes.append(np.sum(water * wall[beside]) / max(np.sum(wall[beside] ** 2), 1e-30))
    return float(slopes[0] / slopes[1]) if slopes[1] else np.nan


def check_clock(case: Case, sides: Sides, path: Path) -> Case:
    """The case; StageError that names keys of `path` where the water contradicts the silhouettes.

    Where a run at the measured pressure tells why the motion differs, only the flow is left out.
    """
    if case.registration.times.size == 0:
        return case
    ratio = clock_ratio(case, sides)
    if np.isfinite(ratio) and not 1 / CLEARLY < ratio < CLEARLY:
        why = (
            f"the water beside the finger moves about {ratio:.2g} times as fast as the"
            " finger in the pictures, which cannot be; frame_rate_hz (of pictures in pairs: the"
            " pairs per second) or piv.interval_s is wrong by about this factor, or the motion"
            f" differs in more than bend and duration; correct it in {path}"
        )
        if case.at_pressure is None:
            raise StageError(why)
        return replace(case, no_flow=why)
    return case
