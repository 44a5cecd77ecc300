"""The finger's motion and clock, simulated and recorded, and what other runs change of it.

Bend and duration are quantities of the comparison; the flow is judged at the recording's motion. A
true stroke of another duration moves the water faster or slower by the same factor. Of a frame rate
that is stated wrongly only the silhouettes change, since the interval within a pair is known.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
import shapely
import xarray as xr
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from pipeline.formats.kinematics import SHAPE, Kinematics
from piv.files.errors import StageError
from piv.formats.plane_series import usable
from postprocess.lab.dpiv_toml import NAME, Dpiv
from postprocess.lab.fit_outline import law_pressure
from postprocess.lab.inputs import EMPTY, Input
from postprocess.lab.pose import camera_series
from postprocess.lab.register import Registration
from postprocess.lab.validation import POSTERIOR, Source, ValidatedQuantity
from postprocess.lab.virtual_experiment import Sides

PARTS = (0.05, 0.95)  # of the bend: between them the stroke lasts
INSTANTS = 801  # at which the bend is looked at
BACK = 0.05  # of the largest bend, to the other side: beyond its shapes they go on straight
NEARER = 3  # steps to the nearest tip
APART = 0.01  # of the largest bend: between two shapes of a coupled motion
NEAR = 0.012  # m from the finger: water that its motion drives
FIRST_HALF = (0.05, 0.5)  # of the bend
FEWEST = 4  # instants
DELAYS = 400  # of vectors without a clock, that are tried
# of ln of the water's speed over the simulation's at equal phase: standard deviation between sound
# recordings (docs/record/laboratory.md); a rate is wrong at odds of 20 to 1, within 3 of them
SPEED_STD, ODDS, FAR_OFF = 0.02, 3.0, 3.0
CONSTANT = 0.07  # of the same over the stroke: largest standard deviation of a constant one


@dataclass(frozen=True)
class Effect:
    """What one run beside the nominal one changes.

    `bend` (rad) and `duration` (s): of the motion. `table`: change of `flow.COLUMNS` at each
    instant; None where the flow is not compared.
    """

    of: Input
    bend: float
    duration: float
    table: pd.DataFrame | None = None

    def changes(self, columns: list[str], rows: np.ndarray) -> np.ndarray:
        """RMS and mean of the change of `columns` over the instants `rows`, (2, component)."""
        assert self.table is not None
        change = self.table.loc[rows, columns].to_numpy(float)
        return np.array([np.sqrt(np.mean(change**2, axis=0)), change.mean(axis=0)])


@dataclass(frozen=True)
class Comparison:
    """One recording: motions of both sides, their flows (None: not compared), effects of runs.

    `bend_std` (rad): of the FEA at the end of the stroke; 0: its bands do not count. `measured`:
    `flow.measure` of each side. `water_speed`: of the recording over the simulation's in the first
    half of the stroke; `all_water`: where it is the same at every instant and not 1.
    `levels`: as of `inputs.level_windows`, and the `level` that is compared.
    """

    dpiv: Dpiv
    kinematics: Kinematics
    registration: Registration
    bend_std: float
    flow: Sides | None = None
    effects: list[Effect] = field(default_factory=list)
    levels: pd.DataFrame = field(default_factory=lambda: EMPTY)
    level: str = ""
    measured: dict[str, pd.DataFrame] = field(default_factory=dict)
    water_speed: float | None = None
    all_water: float | None = None


def final_bend(kinematics: Kinematics, factor: float = 1.0) -> float:
    """Bend angle (rad) at the end of the simulation's law, its change multiplied by a factor."""
    start, end = (float(kinematics.law(t)) for t in kinematics.time)
    return float(kinematics.shape("bend", start + factor * (end - start)))


def bend_done(kinematics: Kinematics, times: np.ndarray) -> np.ndarray:
    """Share of the simulation's largest change of bend that is done at times (n,) s."""
    at = [np.linspace(*kinematics.time, INSTANTS), np.clip(times, *kinematics.time)]
    whole, here = (kinematics.bend(kinematics.law(t)) for t in at)
    return np.asarray(np.abs(here - whole[0]) / np.abs(whole - whole[0]).max())


def stroke_duration(kinematics: Kinematics) -> float:
    """Time (s) from 5 to 95 % of the simulation's change of bend."""
    times = np.linspace(*kinematics.time, INSTANTS)
    done = bend_done(kinematics, times)
    first, last = (float(times[np.argmax(done >= part)]) for part in PARTS)
    return last - first


def over_bend(motion: Kinematics) -> Kinematics:
    """A motion whose shapes are known over time, as a coupled one's, with shapes over its bend.

    The parameter is the angle (rad) by which the finger has bent, the shapes are those of the way
    to the largest bend; on the way back, the one whose tip is nearest, as a silhouette shows it.
    StageError for a finger that bends to both sides.
    """
    bend, times = motion.data["shape_bend"].values, motion.law.x
    sign = np.sign(bend[np.argmax(np.abs(bend - bend[0]))] - bend[0])
    angle = (bend - bend[0]) * sign
    if angle.min() < -BACK * angle.max():
        raise StageError(
            "COUPLED=1 compares a finger that bends to one side, and this one bends to both; cut"
            " the scene's strokes and the recording"
        )
    way = [0]
    for k in range(angle.size):
        if angle[k] >= angle[way[-1]] + APART * angle.max():
            way.append(k)
    data = motion.data.isel({SHAPE: way}).assign_coords({SHAPE: angle[way]})
    splines = {
        name: CubicSpline(angle[way], of_time(of_time.x[way]))
        for name, of_time in motion.splines.items()
    }
    at = (motion.bend(motion.law(times)) - bend[0]) * sign
    made, tip = replace(motion, data=data, splines=splines), motion.shape("tip", motion.law(times))
    step = APART * angle.max()
    for _ in range(NEARER):
        ahead, back = (made.shape("tip", at + s * step) for s in (1, -1))
        slope, apart = (ahead - back) / (2 * step), tip - made.shape("tip", at)
        at = at + np.sum(apart * slope, axis=-1) / np.sum(slope**2, axis=-1)
    return replace(made, law=CubicSpline(times, at))


def difference(nominal: Kinematics, other: Kinematics) -> tuple[float, float]:
    """By how much final bend (rad) and duration (s) of another motion exceed the nominal ones.

    Those of the nominal law, shifted and stretched, whose bend over time is nearest to the other's.
    """
    times = np.linspace(*nominal.time, 101)
    wanted = other.bend(other.law(np.clip(times, *other.time)))
    fit = least_squares(
        lambda values: nominal.bend(law_pressure(nominal, times, values)) - wanted,
        (1.0, 0.0, 1.0),
        x_scale=(0.01, 0.001, 0.01),
    )
    factor, _, stretch = (float(value) for value in fit.x)
    bend = final_bend(nominal, factor) - final_bend(nominal)
    return bend, stroke_duration(nominal) * (stretch - 1)


def _motions(case: Comparison) -> np.ndarray:
    """Final bend (rad) and duration (s): simulated, recorded, standard uncertainty; (2, 3)."""
    law, kinematics = case.registration.law, case.kinematics
    factor, _, stretch = law.values
    seen, lasts = final_bend(kinematics, factor), stroke_duration(kinematics)
    slope = abs(final_bend(kinematics, factor + 0.01) - seen) / 0.01
    bend = [final_bend(kinematics), seen, slope * law.std("factor")]
    return np.array([bend, [lasts, lasts * stretch, lasts * law.std("stretch")]])


def recorded_bend(case: Comparison) -> tuple[Effect, float, float] | None:
    """The run of the pressure, the share of its change of bend by which the recording's differs.

    With the standard uncertainty of that share. None where the motion was not seen, or that run was
    not made. A run that bends the finger by less than silhouettes show, as of a pinch whose tips
    meet, tells nothing of the bend: equal bends need nothing of it, others are not known.
    """
    run = next((e for e in case.effects if e.of.name == "pressure"), None)
    if run is None or case.registration.times.size == 0:
        return None
    simulated, seen, std = _motions(case)[0]
    if abs(run.bend) < FAR_OFF * std:
        return (run, 0.0, 0.0) if abs(seen - simulated) < FAR_OFF * std else None
    return run, (seen - simulated) / run.bend, std / abs(run.bend)


def motion_quantities(case: Comparison) -> list[ValidatedQuantity]:
    """Final bend angle and duration of the stroke; none where the recording does not show them."""
    if case.registration.times.size == 0:
        return []
    out, (bend, lasts) = [], _motions(case)
    for name, label, unit, (simulated, seen, std) in (
        ("final_bend", "bend angle at the end", "rad", bend),
        ("duration", "duration of the stroke", "s", lasts),
    ):
        sources = [Source("silhouette", "data", np.array([std]), POSTERIOR)]
        for e in case.effects:
            change = e.bend if name == "final_bend" else e.duration
            part = np.array([abs(change) * e.of.per_change])
            sources.append(Source(e.of.name, "input", part, e.of.how))
        if case.bend_std and name == "final_bend":
            band = np.array([case.bend_std])
            sources.append(Source("geometry and material", "input", band, "FEA's band"))
        both = np.array([simulated]), np.array([seen])
        out.append(ValidatedQuantity(name, label, unit, *both, abs(float(seen)), sources))
    return out


def with_speeds(case: Comparison, sides: Sides) -> Comparison:
    """The case with the recording's water speed over the simulation's, of strokes of equal length.

    Over what the recording's bend makes of it: 1 of an equal flow.
    """
    if case.registration.times.size == 0:
        return case
    factor, _, stretch = case.registration.law.values
    theirs, ours = (near_speed(one, sides.window_m / 2) for one in (sides.data, sides.virtual))
    with np.errstate(invalid="ignore", divide="ignore"):
        logs = np.log(theirs / ours / factor)
    done = bend_done(case.kinematics, sides.data["time"].values / stretch)

    def within(part: tuple[float, float]) -> np.ndarray:
        inside = logs[(done >= part[0]) & (done <= part[1]) & np.isfinite(logs)]
        return inside if inside.size >= FEWEST else np.empty(0)

    half, whole = within(FIRST_HALF), within(PARTS)
    speed = float(np.exp(np.median(half))) if half.size else None
    alike = whole.size and abs(np.median(whole)) > FAR_OFF * SPEED_STD and np.std(whole) < CONSTANT
    all_water = float(np.exp(np.median(whole))) if alike else None
    return replace(case, water_speed=speed, all_water=all_water)


def near_speed(plane: xr.Dataset, clear: float) -> np.ndarray:
    """RMS speed (m/s) of the water from `clear` (m) to `NEAR` off the finger over time; NaN: none.

    Nearer to it PIV has no vectors.
    """
    points = shapely.points(*np.meshgrid(plane["x"].values, plane["y"].values))
    near = usable(plane).values.copy()
    for seen, outlines in zip(near, plane["outline"].values, strict=True):
        bodies = shapely.MultiPolygon([shapely.Polygon(outline) for outline in outlines])
        shapely.prepare(bodies)
        seen &= shapely.dwithin(bodies, points, NEAR) & ~shapely.dwithin(bodies, points, clear)
    square = np.where(near, plane["u"].values ** 2 + plane["v"].values ** 2, 0.0)
    count = near.sum(axis=(1, 2))
    return np.asarray(np.sqrt(square.sum(axis=(1, 2)) / np.where(count, count, np.nan)))


def check_rate(case: Comparison) -> None:
    """StageError that names frame_rate_hz where the water contradicts it.

    Of pictures that are no pairs the interval is wrong as well, and nothing shows it.
    """
    if case.dpiv.piv.pairing != "1-2,3-4" or case.water_speed is None:
        return
    law, speed = case.registration.law, float(np.log(case.water_speed))
    away = float(np.log(law.values[2]))
    std = np.hypot(SPEED_STD, law.std("stretch") / law.values[2])
    # of a true stroke the ratio is 1, of a rate that is stated wrongly as the silhouettes' duration
    odds = (speed**2 - (speed - away) ** 2) / (2 * std**2)
    if odds > ODDS and abs(speed - away) < FAR_OFF * std:
        raise StageError(
            f"{case.dpiv.folder / NAME}: frame_rate_hz is about {np.exp(-away):.2f} times the true"
            f" one: the finger seems to take {np.exp(away):.2f} times as long as the simulation's,"
            " and the water beside it moves as fast as the simulation's; write the pairs per second"
        )


def onset(registration: Registration, plane: xr.Dataset, sheet: xr.Dataset) -> Registration:
    """The registration of vectors (`lab_vectors`) with the delay that their speed shows.

    Least squares of the RMS speed over time by the simulation's times a free factor.
    """
    pose, clock, times = registration.pose, sheet["time"].values, plane["time"].values
    x, y = (plane[n].values * pose.pixel for n in ("x", "y"))
    ours, theirs = (
        np.sqrt(np.nanmean(one["u"].values ** 2 + one["v"].values ** 2, axis=(1, 2)))
        for one in (camera_series(sheet, pose, x, y, clock), plane)
    )
    delays = np.linspace(times[0] - clock[-1], times[-1] - clock[0], DELAYS)[1:-1]
    seen = np.interp(times - delays[:, None], clock, ours)
    rest = theirs - seen * (seen @ theirs / np.sum(seen**2, axis=1).clip(1e-30))[:, None]
    left = np.sum(rest**2, axis=1)
    best = int(np.clip(np.argmin(left), 1, delays.size - 2))
    step = delays[1] - delays[0]
    bend = max((left[best - 1] - 2 * left[best] + left[best + 1]) / step**2, 1e-30)
    variance = 2 * left[best] / max(times.size - 2, 1) / bend + step**2 / 12
    values, covariance = np.array([1.0, delays[best], 1.0]), np.diag([0.0, variance, 0.0])
    law = replace(registration.law, values=values, covariance=covariance)
    return replace(registration, law=law)
