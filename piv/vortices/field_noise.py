"""Noise of vectors that state no uncertainty, from the field itself.

Fourth differences over k grid steps leave little of a flow: they grow as k⁴ in a smooth one. Those
of noise stay, and grow until k steps part its vectors' errors.
"""

import numpy as np
from numpy import ndarray

_REACHES = (1, 2, 3)  # grid steps; windows of PIV overlap over up to four
_GROWS = 1.2  # differences of errors that are alike over k steps grow by more to the next reach
_LEAST = 20  # differences that give a median
_TO_STD = 1.4826  # of a normal distribution over its median deviation


def field_noise(u: ndarray, v: ndarray) -> tuple[float, float, int]:
    """Standard deviations of errors of u and v (y, x), and grid steps over which they are alike.

    NaN where absent. By medians, so that vortices and walls count little.
    """
    found = [[_spread(field, reach) for reach in _REACHES] for field in (u, v)]
    best = 0
    for k in range(1, len(_REACHES)):
        most = (_REACHES[k] / _REACHES[k - 1]) ** 2  # of a smooth flow it is the square of this
        grown = [f[k] / f[k - 1] if f[k - 1] > 0 else np.inf for f in found]
        if not all(_GROWS < g < most for g in grown):
            break
        best = k
    return found[0][best], found[1][best], _REACHES[best]


def _spread(field: ndarray, reach: int) -> float:
    """Standard deviation of white noise, by the calmest of three fourth differences; 0 if unknown.

    Parallel shear has none across one of these directions.
    """
    spreads = []
    # normed by what they make of white noise of unit variance
    for axes, norm in (((0, 1), 6.0), ((0, 0), 70**0.5), ((1, 1), 70**0.5)):
        values = np.abs(_second(_second(field, axes[0], reach), axes[1], reach))
        values = values[np.isfinite(values)]
        if values.size >= _LEAST:
            spreads.append(_TO_STD * float(np.median(values)) / norm)
    return min(spreads, default=0.0)


def _second(field: ndarray, axis: int, reach: int) -> ndarray:
    """Second differences along an axis between vectors `reach` steps apart."""
    rows = np.moveaxis(field, axis, 0)
    count = max(len(rows) - 2 * reach, 0)
    ends = rows[:count] + rows[2 * reach : 2 * reach + count]
    return np.moveaxis(ends - 2 * rows[reach : reach + count], 0, axis)
