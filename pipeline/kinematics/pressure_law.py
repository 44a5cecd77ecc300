"""Smooth pressure over time: three-pole strokes, or a measured history."""

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy import ndarray
from scipy.interpolate import CubicSpline

from pipeline.scene.sections import SMOOTHING
from piv.files.errors import StageError
from piv.formats.user_tables import read_history

_ATMOSPHERE = 90e3  # Pa, or more: at rest no finger has so much
_FEWEST = 3  # rows of a long table within the run; fewer are a sign of times in ms
_HARMLESS = 0.01  # of a range of pressure: what a longer smoothing may change
_STILL = 0.1  # of a history's largest rate, below which it rests
SETTLING_2_PERCENT = 7.5166  # x at which 1 - (1 + x + x^2/2) exp(-x) = 0.98


class PressureLaw(Protocol):
    """Pressure (Pa) and its time derivatives at times in s."""

    def __call__(self, time: ndarray, derivative: int = 0) -> ndarray: ...


def three_pole(x: ndarray, derivative: int = 0) -> ndarray:
    """Step response of three equal real poles, 0 for x <= 0, or its first or second derivative."""
    x = np.maximum(x, 0.0)
    if derivative == 0:
        return 1 - (1 + x + x**2 / 2) * np.exp(-x)
    return (x**2 / 2 if derivative == 1 else x - x**2 / 2) * np.exp(-x)


def stroke_law(start_pressure: float, strokes: list[tuple[float, float, float]]) -> PressureLaw:
    """Superposed strokes (pressure Pa, start s, duration s), each then 2 % from its end."""
    steps = np.diff([start_pressure] + [stroke[0] for stroke in strokes])

    def law(time: ndarray, derivative: int = 0) -> ndarray:
        time = np.asarray(time, float)
        total = np.full(time.shape, start_pressure if derivative == 0 else 0.0)
        for step, (_, start, duration) in zip(steps, strokes, strict=True):
            tau = duration / SETTLING_2_PERCENT
            total += step * three_pole((time - start) / tau, derivative) / tau**derivative
        return total

    return law


def measured_law(path: Path, smoothing: float = SMOOTHING, end_time: float = np.inf) -> PressureLaw:
    """The history of a table `t, p` (s, Pa), averaged over `smoothing` s; StageError.

    It is held constant before and after. Without smoothing: a cubic spline through the rows.
    `end_time` of the run (s): refused where the pressure changes after it alone.
    """
    # a spline needs three rows; two are a ramp
    times, pressure = read_history(path, "pressure", least=2 if smoothing else 3)
    if not (span := np.ptp(pressure)):
        raise StageError(f"{path}: the pressure never changes; give one that moves the finger")
    if span < 200:
        raise StageError(f"{path}: pressures span {span:.3g} Pa, which looks like kPa; give Pa")
    begun = int(np.searchsorted(times, end_time))
    if not np.ptp(pressure[: begun + 1]) or begun < _FEWEST <= len(times) / 4:
        raise StageError(
            f"{path}: {begun} of {len(times)} rows lie before motion.end_time = {end_time:g} s, too"
            " few for a motion; give a later end_time, or name the column t [ms] if it is in ms"
        )
    if smoothing:
        return _averaged_law(times, pressure, smoothing)
    return history_law(times, pressure)


def harmless_smoothing(path: Path, longest: float) -> float:
    """The longest average (s) of a history, centred, that changes it by 1 % of its range at most.

    Of `longest`, its half, its quarter and so on; else the usual one. StageError.
    """
    times, values = read_history(path, "pressure", least=2)
    time = np.arange(times[0], times[-1], 0.25 * SMOOTHING)
    usual = measured_law(path)(time + 0.5 * SMOOTHING)
    span = round(longest, 3)
    while span >= 2 * SMOOTHING:
        change = np.abs(measured_law(path, span)(time + 0.5 * span) - usual).max()
        if change < _HARMLESS * np.ptp(values):
            return span
        span = round(0.5 * span, 3)
    return SMOOTHING


def moving_time(path: Path, smoothing: float) -> float:
    """Seconds in which a smoothed history changes by a tenth of its largest rate or faster.

    StageError.
    """
    times, _ = read_history(path, "pressure", least=2)
    time = np.arange(times[0], times[-1] + smoothing, 0.25 * smoothing)
    rate = np.abs(measured_law(path, smoothing)(time, 1))
    return 0.25 * smoothing * float(np.count_nonzero(rate > _STILL * rate.max()))


def absolute(path: Path) -> str:
    """A remark on a history that begins as absolute pressures do; "" on another."""
    start = float(read_history(path, "pressure", least=2)[1][0])
    if start < _ATMOSPHERE:
        return ""
    return (
        f"{path} begins at {start / 1e3:.4g} kPa, as absolute pressures do: a finger's is against"
        " the water around it; subtract the pressure at rest"
    )


def smooth_step(x: ndarray, derivative: int = 0) -> ndarray:
    """0 before 0, 1 after 1, three times continuously differentiable.

    Or its first derivative, or (-1) its integral.
    """
    x, beyond = np.clip(x, 0.0, 1.0), np.maximum(x - 1, 0.0)
    if derivative == -1:
        return x**5 * (7 - 14 * x + 10 * x**2 - 2.5 * x**3) + beyond
    if derivative == 0:
        return x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3)
    return 140 * x**3 * (1 - x) ** 3


def _averaged_law(times: ndarray, pressure: ndarray, span: float) -> PressureLaw:
    """A history (s, Pa) by straight lines, averaged over the `span` (s) before each instant.

    It starts from rest, does not overshoot, and lags by half of the span.
    """
    slopes = np.concatenate([[0.0], np.diff(pressure) / np.diff(times), [0.0]])
    turns = np.diff(slopes)  # of the slope at each row
    # of all rows that the average has passed: a straight line
    sums = np.concatenate([[0.0], np.cumsum(turns)])
    moments = np.concatenate([[0.0], np.cumsum(turns * (times + 0.5 * span))])

    def law(time: ndarray, derivative: int = 0) -> ndarray:
        t = np.asarray(time, float)
        passed, begun = (np.searchsorted(times, t - before) for before in (span, 0.0))
        line = (sums[passed] * t - moments[passed] + pressure[0], sums[passed], np.zeros(t.shape))
        total = line[derivative]
        for k in range(int(np.max(begun - passed, initial=0))):
            row = np.minimum(passed + k, len(times) - 1)
            part = smooth_step((t - times[row]) / span, derivative - 1) * span ** (1 - derivative)
            total = total + np.where(passed + k < begun, turns[row] * part, 0.0)
        return total

    return law


def history_law(times: ndarray, pressure: ndarray) -> PressureLaw:
    """Cubic spline through a history (s, Pa), held constant before and after."""
    rest = np.min(np.diff(times)) * np.arange(1, 5)
    spline = CubicSpline(  # constant knots at both ends let the spline settle: C2 there too
        np.concatenate([times[0] - rest[::-1], times, times[-1] + rest]),
        np.concatenate([np.full(4, pressure[0]), pressure, np.full(4, pressure[-1])]),
        bc_type="clamped",
    )
    first, last = spline.x[0], spline.x[-1]

    def law(time: ndarray, derivative: int = 0) -> ndarray:
        t = np.asarray(time, float)
        inside = (t >= first) & (t <= last)
        outside = np.where(t < first, pressure[0], pressure[-1]) if derivative == 0 else 0.0
        return np.where(inside, spline(np.clip(t, first, last), derivative), outside)

    return law
