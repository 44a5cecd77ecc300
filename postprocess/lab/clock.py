"""Whether the water contradicts the recording's clock: its speed at equal phase of the stroke.

A true stroke of another duration moves the water faster or slower by the same factor. Of a frame
rate that is stated wrongly only the silhouettes change, since the interval within a pair is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
import xarray as xr

from piv.files.errors import StageError
from piv.formats.plane_series import usable
from postprocess.lab.motion import Comparison, bend_done
from postprocess.lab.pose import camera_series
from postprocess.lab.register import Registration
from postprocess.lab.virtual_experiment import Sides

NEAR = 0.012  # m from the finger: water that its motion drives
FIRST_HALF, STROKE = (0.05, 0.5), (0.05, 0.95)  # of the bend
FEWEST = 4  # instants
DELAYS = 400  # of vectors without a clock, that are tried
# ln(ratio) over ln(stretch) is 0 for a true stroke and 1 for a wrong rate; the ratio of a sound
# recording scatters by 3 %, so a smaller stretch cannot be told (docs/record/laboratory.md)
RATE, LEAST_STRETCH = (0.6, 1.6), 0.08
# of ln(ratio) over the stroke: standard deviation of a constant one, and its least size
CONSTANT, CLEARLY = 0.07, 0.08


@dataclass(frozen=True)
class SpeedRatio:
    """Speed of the recording's water over the simulation's, at `phase` (s of the simulation).

    At equal phase, over what the recording's motion makes of it: 1 of an equal flow.
    """

    phase: np.ndarray
    ratio: np.ndarray
    done: np.ndarray  # share of the bend

    def within(self, part: tuple[float, float]) -> np.ndarray:
        """ln of the ratios in a part of the bend; empty of fewer than `FEWEST` instants."""
        ok = (self.done >= part[0]) & (self.done <= part[1]) & (self.ratio > 0)
        return np.log(self.ratio[ok]) if ok.sum() >= FEWEST else np.empty(0)


def speed_ratio(case: Comparison, sides: Sides) -> SpeedRatio:
    """The ratio at the recording's instants."""
    factor, _, stretch = case.registration.law.values
    phase = sides.data["time"].values / stretch
    ours = np.interp(phase, sides.virtual["time"].values, near_speed(sides.virtual), np.nan, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = near_speed(sides.data) / ours * stretch / factor
    return SpeedRatio(phase, ratio, bend_done(case.kinematics, phase))


def near_speed(plane: xr.Dataset) -> np.ndarray:
    """RMS speed (m/s) of the water within `NEAR` of the finger at each instant; NaN of none."""
    points = shapely.points(*np.meshgrid(plane["x"].values, plane["y"].values))
    near = usable(plane).values.copy()
    for seen, outlines in zip(near, plane["outline"].values, strict=True):
        bodies = shapely.MultiPolygon([shapely.Polygon(outline) for outline in outlines])
        shapely.prepare(bodies)
        seen &= shapely.dwithin(bodies, points, NEAR)
    square = np.where(near, plane["u"].values ** 2 + plane["v"].values ** 2, 0.0)
    count = near.sum(axis=(1, 2))
    return np.asarray(np.sqrt(square.sum(axis=(1, 2)) / np.where(count, count, np.nan)))


def onset(registration: Registration, plane: xr.Dataset, sheet: xr.Dataset) -> Registration:
    """The registration of vectors (`lab_vectors`) with the delay that their speed shows.

    Least squares of the RMS speed over time by the simulation's times a free factor.
    """
    pose, clock = registration.pose, sheet["time"].values
    x, y = (plane[n].values * pose.pixel for n in ("x", "y"))
    ours, theirs = (
        np.sqrt(np.nanmean(one["u"].values ** 2 + one["v"].values ** 2, axis=(1, 2)))
        for one in (camera_series(sheet, pose, x, y, clock), plane)
    )
    times = plane["time"].values
    delays = np.linspace(times[0] - clock[-1], times[-1] - clock[0], DELAYS)[1:-1]
    left = np.full(delays.size, np.inf)
    for k, delay in enumerate(delays):
        seen = np.interp(times - delay, clock, ours, ours[0], ours[-1])
        rest = theirs - seen * (seen @ theirs) / max(seen @ seen, 1e-30)
        left[k] = rest @ rest
    best = int(np.clip(np.argmin(left), 1, delays.size - 2))
    step = delays[1] - delays[0]
    bend = (left[best - 1] - 2 * left[best] + left[best + 1]) / step**2
    std = np.sqrt(2 * left[best] / max(times.size - 2, 1) / max(bend, 1e-30))
    delay = float(delays[best])
    law = replace(
        registration.law,
        values=np.array([1.0, delay, 1.0]),
        covariance=np.diag([0.0, std**2 + step**2 / 12, 0.0]),
    )
    return replace(registration, law=law)


def check_rate(case: Comparison, sides: Sides, paired: bool, path: Path) -> None:
    """StageError that names frame_rate_hz of `path` where the water contradicts it.

    Of pictures that are no pairs the interval is wrong as well, and nothing shows it.
    """
    law = case.registration.law
    if not paired or case.registration.times.size == 0:
        return
    away, logs = float(np.log(law.values[2])), speed_ratio(case, sides).within(FIRST_HALF)
    least = max(3 * law.std("stretch") / law.values[2], LEAST_STRETCH)
    if abs(away) > least and logs.size and RATE[0] < np.median(logs) / away < RATE[1]:
        raise StageError(
            f"{path}: frame_rate_hz is about {np.exp(-away):.2f} times the true one: the finger"
            f" seems to take {np.exp(away):.2f} times as long as the simulation's, and the water"
            " beside it moves as fast as the simulation's; write the pairs of pictures per second"
        )


def constant_ratio(case: Comparison, sides: Sides) -> float | None:
    """The factor by which all water moves at every instant of the stroke; None of another flow."""
    if case.registration.times.size == 0:
        return None
    logs = speed_ratio(case, sides).within(STROKE)
    if logs.size and abs(np.median(logs)) > CLEARLY and np.std(logs) < CONSTANT:
        return float(np.exp(np.median(logs)))
    return None
