"""Contact of a pinch: the gap of a finger, and the pressure law by which it stops there.

The free motion would carry the tips through each other. Its pressure is mapped, p = h(p_free), so
that the finger slows down smoothly and stops at the residual gap. The map acts on the pressure,
because the gap has kinks where another point of the outline becomes the nearest one.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from scipy.optimize import brentq
from scipy.special import expit

from pipeline.kinematics.pressure_law import PressureLaw
from pipeline.scene.pinch import Pinch
from piv.files.errors import StageError

_SCAN = 0.25e3  # Pa: steps of the search for contact, half a degree of bend apart
_SCANS = 50  # at least; for shapes over time
_STOPPED = 1e-4  # m from the residual gap: contact


def gap(outlines: ndarray, pinch: Pinch) -> ndarray:
    """Least distance (...,) m of outlines (..., point, 2) to the plane x = 0 and to the object.

    Negative beyond the plane, or inside the object.
    """
    plane = -outlines[..., 0].max(axis=-1)
    if pinch.object is None:
        return plane
    start = outlines - np.array([0.0, pinch.object.centre_height])
    side = np.roll(start, -1, axis=-2) - start
    along = -(start * side).sum(-1) / np.maximum((side**2).sum(-1), 1e-300)
    nearest = start + np.clip(along, 0, 1)[..., None] * side
    distance = np.hypot(nearest[..., 0], nearest[..., 1]).min(axis=-1)
    return np.minimum(plane, distance - 0.5 * pinch.object.diameter)


def nearest(outline: ndarray, pinch: Pinch) -> tuple[ndarray, ndarray]:
    """The point (2,) m of an outline (point, 2) that is nearest, and the unit vector away."""
    if pinch.object is not None:
        centre = np.array([0.0, pinch.object.centre_height])
        apart = outline - centre
        distance = np.hypot(*apart.T)
        at = int(np.argmin(distance))
        if distance[at] - 0.5 * pinch.object.diameter < -outline[:, 0].max():
            return outline[at], apart[at] / distance[at]
    return outline[np.argmax(outline[:, 0])], np.array([-1.0, 0.0])


def ramp(x: ndarray, derivative: int = 0) -> ndarray:
    """0 for x <= -1, x for x >= 1, three times continuously differentiable; slope 0 to 1."""
    u = np.clip(0.5 * (np.asarray(x, float) + 1), 0, 1)
    if derivative == 0:
        return np.where(u < 1, u**4 * (5 - 6 * u + 2 * u**2), x)
    return u**3 * (10 - 15 * u + 6 * u**2) if derivative == 1 else 15 * u**2 * (1 - u) ** 2


def exponential(x: ndarray, derivative: int = 0) -> ndarray:
    """ln(1 + exp(4 x)) / 4: x far above 0, decaying exponentially below; slope 0 to 1."""
    x = 4 * np.asarray(x, float)
    if derivative == 0:
        return np.logaddexp(0, x) / 4
    return expit(x) if derivative == 1 else 4 * expit(x) * expit(-x)


_SHAPES = {"ramp": ramp, "exponential": exponential}


@dataclass(frozen=True)
class ClosingLaw:
    """A free law, slowed down over `slowing` Pa before and after `hold` Pa, its maximum."""

    free: PressureLaw
    hold: float
    slowing: float
    shape: Callable[..., ndarray]

    def __call__(self, time: ndarray, derivative: int = 0) -> ndarray:
        """Pressure (Pa) of the shape at `time` s, or its first or second derivative."""
        free = self.free(time)
        short = (self.hold - free) / self.slowing
        if derivative == 0:
            # the lag behind the free law: exactly nothing where the map does not act
            return free - self.slowing * (self.shape(short) - short)
        slope, rate = self.shape(short, 1), self.free(time, 1)
        if derivative == 1:
            return slope * rate
        return slope * self.free(time, 2) - self.shape(short, 2) * rate**2 / self.slowing


def closing_law(
    free: PressureLaw,
    gap_at: Callable[[float], float],
    start: float,
    highest: float,
    pinch: Pinch,
    where: str,
) -> PressureLaw:
    """The free law, slowed down to the residual gap if a pressure up to `highest` leads there.

    `gap_at` gives the gap (m) at a pressure (Pa). Raises StageError, naming `where`, if the finger
    is in contact at its `start` pressure.
    """
    first = gap_at(start)
    if first <= pinch.residual_gap:
        raise StageError(
            f"{where}: pinch: the finger starts with a gap of {first * 1e3:.2f} mm to the plane"
            f" {'or the object' if pinch.object else 'between the fingers'}, not more than"
            f" pinch.residual_gap = {pinch.residual_gap:g} m; raise pinch.half_distance or start"
            " more open"
        )
    hold = _reach(gap_at, pinch.residual_gap, start, highest)
    if hold is None:
        return free
    near = _reach(gap_at, pinch.residual_gap + pinch.slowing_distance, start, hold)
    if near is None:
        raise StageError(
            f"{where}: pinch.slowing_distance = {pinch.slowing_distance:g} m is more than the"
            f" finger moves before contact, {(first - pinch.residual_gap) * 1e3:.2f} mm; give less"
        )
    return ClosingLaw(free, hold, hold - near, _SHAPES[pinch.closing_law])


def _reach(
    gap_at: Callable[[float], float], value: float, start: float, highest: float
) -> float | None:
    """Lowest pressure (Pa) above `start` at which the gap is down to `value`; None if none."""
    step = min(_SCAN, (highest - start) / _SCANS or _SCAN)
    at = np.append(np.arange(start, highest, step), highest)
    gaps = np.array([gap_at(p) for p in at]) - value
    if gaps[0] <= 0 or gaps.min() > 0:
        return None
    k = int(np.argmax(gaps <= 0))
    return float(brentq(lambda p: gap_at(p) - value, at[k - 1], at[k], xtol=1e-9, rtol=1e-14))


def closing_summary(time: ndarray, gaps: ndarray, pinch: Pinch) -> dict[str, float]:
    """`least_gap` (m), `peak_closing_speed` (m/s) and, where it is reached, `contact_time` (s)."""
    summary = {
        "residual_gap": pinch.residual_gap,
        "least_gap": float(gaps.min()),
        "peak_closing_speed": float(-np.gradient(gaps, time).min()),
    }
    closed = gaps <= pinch.residual_gap + _STOPPED
    if closed.any():
        summary["contact_time"] = float(time[np.argmax(closed)])
    return summary


def closing_sentence(summary: dict[str, float]) -> str:
    """Say in a sentence when and how fast the fingers close."""
    least = (
        f"least gap {summary['least_gap'] * 1e3:.3f} mm,"
        f" closing ≤ {summary['peak_closing_speed']:.3f} m/s"
    )
    if "contact_time" in summary:
        return f"{least}, in contact from {summary['contact_time']:.4f} s on"
    residual = summary["residual_gap"] * 1e3
    return f"{least}; the tips do not come to the residual gap of {residual:g} mm"
