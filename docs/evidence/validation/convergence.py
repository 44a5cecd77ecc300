"""Grid convergence: observed order, extrapolated value and uncertainty from three grids or more.

Three grids: Richardson extrapolation and the grid-convergence index of Roache (1994), for unequal
ratios as Celik et al. (2008, J. Fluids Eng. 130:078001). More grids, or an unsound order: least
squares of Eça & Hoekstra (2014, J. Comput. Phys. 262:104).
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import brentq, minimize_scalar

SAFETY = 1.25  # for a sound order
SAFETY_DOUBTFUL = 3.0
SOUND = (0.5, 2.1)  # orders that Eça & Hoekstra accept
LEAST_ORDER, LARGEST_ORDER = 1e-3, 40.0


@dataclass(frozen=True)
class Estimate:
    """Extrapolated value, order, and uncertainty (95 %) of each grid's value.

    `order` is None where no power that the schemes can have fits; `kind`: the function fitted.
    """

    extrapolated: float
    order: float | None
    uncertainty: np.ndarray
    kind: str


def three_grids(size: np.ndarray, value: np.ndarray) -> Estimate:
    """Richardson's extrapolation from three cell sizes; ValueError if the values do not converge.

    `uncertainty` is the grid-convergence index in the value's unit.
    """
    size, value = np.asarray(size, float), np.asarray(value, float)
    if size.shape != (3,) or value.shape != (3,):
        raise ValueError(f"{size.size} sizes and {value.size} values; three of each are needed")
    order = np.argsort(size)
    h, f = size[order], value[order]
    fine, coarse = f[1] - f[0], f[2] - f[1]
    if fine == 0 or coarse / fine <= 0:
        raise ValueError(f"the values {f.tolist()} do not converge monotonically")
    r_fine, r_coarse = h[1] / h[0], h[2] / h[1]
    ratio = np.log(coarse / fine)

    # grows with the order; a fixed point of it need not converge for unequal ratios
    def excess(power: float) -> float:
        grown = np.log((r_coarse**power - 1) / (r_fine**power - 1))
        return float(grown + power * np.log(r_fine) - ratio)

    if excess(LEAST_ORDER) > 0 or excess(LARGEST_ORDER) < 0:
        raise ValueError(f"the values {f.tolist()} do not converge as the cells shrink")
    power = float(brentq(excess, LEAST_ORDER, LARGEST_ORDER, xtol=1e-13))
    limit = f[0] - fine / (r_fine**power - 1)
    return Estimate(float(limit), power, SAFETY * np.abs(value - limit), "three grids")


def least_squares(size: np.ndarray, value: np.ndarray) -> Estimate:
    """Eça & Hoekstra's procedure for four grids or more (three: exact fit, no scatter)."""
    h, f = np.asarray(size, float), np.asarray(value, float)
    if len(h) < 3 or len(h) != len(f):
        raise ValueError(f"{len(h)} sizes and {len(f)} values; at least three of each are needed")
    h = h / h.min()
    spread = (f.max() - f.min()) / (len(f) - 1)
    fits = [_power_fit(h, f, weight) for weight in _weights(h)]
    limit, power, scatter, fitted = min(fits, key=lambda fit: fit[2])
    kind, order = "power", power
    if power is None or not SOUND[0] <= power <= SOUND[1]:
        terms: list[tuple[float, ...]] = [(1.0,), (2.0,)]
        if len(h) > 3 and (power is None or power <= SOUND[1]):
            terms.append((1.0, 2.0))  # super-convergence is not trusted
        ways = product(terms, _weights(h))
        tried = [(*_linear_fit(h, f, weight, powers), powers) for powers, weight in ways]
        limit, scatter, fitted, powers = min(tried, key=lambda t: t[1])
        kind, order = "h" + " + h²" * (len(powers) == 2) if powers[0] == 1.0 else "h²", None
    distance = np.abs(f - limit)
    if scatter < spread:
        safety = SAFETY_DOUBTFUL if order is None else SAFETY
        uncertainty = safety * distance + scatter + np.abs(f - fitted)
    else:
        uncertainty = 3 * scatter / max(spread, 1e-300) * (distance + scatter + np.abs(f - fitted))
    return Estimate(float(limit), order, uncertainty, kind)


def estimate(size: np.ndarray, value: np.ndarray) -> Estimate:
    """Richardson's extrapolation where three grids have a sound order, else least squares."""
    if len(size) == 3:
        try:
            fit = three_grids(size, value)
        except ValueError:
            return least_squares(size, value)
        if fit.order is not None and SOUND[0] <= fit.order <= SOUND[1]:
            return fit
    return least_squares(size, value)


def _weights(h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Equal weights, and larger ones for finer grids."""
    return np.full(len(h), 1 / len(h)), (1 / h) / (1 / h).sum()


def _linear_fit(
    h: np.ndarray, f: np.ndarray, weight: np.ndarray, powers: tuple[float, ...]
) -> tuple[float, float, np.ndarray]:
    """Limit, standard deviation and fitted values of f = limit + Σ a h^p."""
    matrix = np.column_stack([np.ones_like(h), *(h**p for p in powers)])
    root = np.sqrt(weight)
    coefficients, *_ = np.linalg.lstsq(matrix * root[:, None], f * root, rcond=None)
    fitted = matrix @ coefficients
    freedom = max(len(h) - matrix.shape[1], 1)
    scatter = np.sqrt(len(h) * np.sum(weight * (f - fitted) ** 2) / freedom)
    return float(coefficients[0]), float(scatter), fitted


def _power_fit(
    h: np.ndarray, f: np.ndarray, weight: np.ndarray
) -> tuple[float, float | None, float, np.ndarray]:
    """Limit, order (None: none fits best), standard deviation and values of f = limit + a h^p."""

    def misfit(power: float) -> float:
        fitted = _linear_fit(h, f, weight, (power,))[2]
        return float(np.sum(weight * (f - fitted) ** 2))

    grid = np.linspace(0.05, 8.0, 160)
    at = int(np.argmin([misfit(p) for p in grid]))
    inside = 0 < at < len(grid) - 1
    low, high = grid[max(at - 1, 0)], grid[min(at + 1, len(grid) - 1)]
    options = {"method": "bounded", "options": {"xatol": 1e-10}}
    power = float(minimize_scalar(misfit, bounds=(low, high), **options).x)
    limit, _, fitted = _linear_fit(h, f, weight, (power,))
    freedom = max(len(h) - 3, 1)
    scatter = np.sqrt(len(h) * np.sum(weight * (f - fitted) ** 2) / freedom)
    return limit, power if inside else None, float(scatter), fitted
