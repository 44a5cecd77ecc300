"""Contact of a pinch: how far a finger is from the plane (or the object), and the law by which it stops there.

The free motion would carry the tips through each other. Its pressure is mapped, p = h(p_free), so that the finger slows
down smoothly, stops at the residual gap and is held there. The map acts on pressure, not on the gap itself: the gap has
kinks where another point of the outline becomes the nearest one, and a motion made through its inverse would jump in speed.
Over the slowing distance the gap is all but linear in pressure.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import expit

from fileio.errors import StageError
from pipeline.kinematics.pressure_law import PressureLaw
from pipeline.scene.pinch import Pinch

SCAN = 0.25e3  # Pa: steps in which the pressure of contact is searched, half a degree of bend apart
SCANS = 50  # at least; for shapes that follow the time
STOPPED = (
    1e-4  # m: a gap within this of the residual one is contact; the ramp takes long over the rest
)


def gap(outlines: np.ndarray, pinch: Pinch) -> np.ndarray:
    """Least distance (...,) m of outlines (..., point, 2) to the plane x = 0 and to the pinch's object.

    Negative beyond the plane, or inside the object. Segments are straight from point to point.
    """
    plane = -outlines[..., 0].max(axis=-1)
    if pinch.object is None:
        return plane
    start = outlines - np.array([0.0, pinch.object.centre_height])
    side = np.roll(start, -1, axis=-2) - start
    along = -(start * side).sum(-1) / np.maximum((side**2).sum(-1), 1e-300)
    nearest = start + np.clip(along, 0, 1)[..., None] * side
    return np.minimum(
        plane, np.hypot(nearest[..., 0], nearest[..., 1]).min(axis=-1) - 0.5 * pinch.object.diameter
    )


def ramp(x: np.ndarray, derivative: int = 0) -> np.ndarray:
    """0 for x <= -1, x for x >= 1, three times continuously differentiable; 0 <= slope <= 1, curvature <= 15/16."""
    u = np.clip(0.5 * (np.asarray(x, float) + 1), 0, 1)
    if derivative == 0:
        return np.where(u < 1, u**4 * (5 - 6 * u + 2 * u**2), x)
    if derivative == 1:
        return u**3 * (10 - 15 * u + 6 * u**2)
    if derivative == 2:
        return 15 * u**2 * (1 - u) ** 2
    raise ValueError(f"derivative = {derivative} of the ramp: give 0, 1 or 2")


def exponential(x: np.ndarray, derivative: int = 0) -> np.ndarray:
    """ln(1 + exp(4 x)) / 4: x far above 0, decaying exponentially below; slope 0 to 1, curvature <= 1."""
    x = np.asarray(x, float)
    if derivative == 0:
        return np.logaddexp(0, 4 * x) / 4
    if derivative == 1:
        return expit(4 * x)
    if derivative == 2:
        return 4 * expit(4 * x) * expit(-4 * x)
    raise ValueError(f"derivative = {derivative} of the closing law: give 0, 1 or 2")


CLOSING_LAWS: dict[str, Callable[..., np.ndarray]] = {"ramp": ramp, "exponential": exponential}


@dataclass(frozen=True)
class ClosingLaw:
    """A free pressure law that is slowed down over `slowing` Pa before and after `hold` Pa, and never exceeds `hold`."""

    free: PressureLaw
    hold: float
    slowing: float
    shape: Callable[..., np.ndarray]

    def __call__(self, time: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Pressure (Pa) of the shape at `time` s, or its first or second derivative."""
        free = self.free(time)
        short = (self.hold - free) / self.slowing
        if derivative == 0:
            # by how much the law lags behind the free one: exactly nothing where it does not act
            return free - self.slowing * (self.shape(short) - short)
        slope, rate = self.shape(short, 1), self.free(time, 1)
        if derivative == 1:
            return slope * rate
        if derivative == 2:
            return slope * self.free(time, 2) - self.shape(short, 2) * rate**2 / self.slowing
        raise ValueError(f"derivative = {derivative} of the closing law: give 0, 1 or 2")


def closing_law(
    free: PressureLaw,
    gap_at: Callable[[float], float],
    start: float,
    highest: float,
    pinch: Pinch,
    where: str,
) -> PressureLaw:
    """The free law, slowed down to the pinch's residual gap; itself where no pressure up to `highest` brings it there.

    `gap_at` gives the gap (m) at a pressure (Pa). Raises StageError, naming `where`, if the finger is in contact at its
    `start` pressure.
    """
    if gap_at(start) <= pinch.residual_gap:
        what = (
            "the plane between the fingers" if pinch.object is None else "the plane or the object"
        )
        raise StageError(
            f"{where}: pinch: the finger starts with a gap of {gap_at(start) * 1e3:.2f} mm to {what}, not more than"
            f" pinch.residual_gap = {pinch.residual_gap:g} m; raise pinch.half_distance or start more open"
        )
    hold = _reach(gap_at, pinch.residual_gap, start, highest)
    if hold is None:
        return free
    near = _reach(gap_at, pinch.residual_gap + pinch.slowing_distance, start, hold)
    if near is None:
        raise StageError(
            f"{where}: pinch.slowing_distance = {pinch.slowing_distance:g} m is more than the finger moves"
            f" before contact, {(gap_at(start) - pinch.residual_gap) * 1e3:.2f} mm; give less"
        )
    return ClosingLaw(free, hold, hold - near, CLOSING_LAWS[pinch.closing_law])


def _reach(
    gap_at: Callable[[float], float], value: float, start: float, highest: float
) -> float | None:
    """The lowest pressure above `start` at which the gap has come down to `value`, exact to 1e-12 Pa; None if none."""
    at = np.append(np.arange(start, highest, min(SCAN, (highest - start) / SCANS or SCAN)), highest)
    gaps = np.array([gap_at(p) for p in at]) - value
    if gaps[0] <= 0 or gaps.min() > 0:
        return None
    first = int(np.argmax(gaps <= 0))
    return float(
        brentq(lambda p: gap_at(p) - value, at[first - 1], at[first], xtol=1e-9, rtol=1e-14)
    )


def closing_summary(time: np.ndarray, gaps: np.ndarray, pinch: Pinch) -> dict[str, float]:
    """`least_gap` (m), `peak_closing_speed` (m/s, of the gap), and where it is reached `contact_time` (s)."""
    summary = {
        "residual_gap": pinch.residual_gap,
        "least_gap": float(gaps.min()),
        "peak_closing_speed": float(-np.gradient(gaps, time).min()),
    }
    closed = gaps <= pinch.residual_gap + STOPPED
    if closed.any():
        summary["contact_time"] = float(time[np.argmax(closed)])
    return summary


def closing_sentence(summary: dict[str, float]) -> str:
    """The summary in a sentence."""
    least = f"least gap {summary['least_gap'] * 1e3:.3f} mm, closing ≤ {summary['peak_closing_speed']:.3f} m/s"
    if "contact_time" not in summary:
        return f"{least}; the tips do not come to the residual gap of {summary['residual_gap'] * 1e3:g} mm"
    return f"{least}, in contact from {summary['contact_time']:.4f} s on"
