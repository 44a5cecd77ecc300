"""Circulation of a plane field round a circle: line integral, and area integral of the vorticity."""

from __future__ import annotations

import numpy as np
from scipy import ndimage


def clear_radius(
    distance: np.ndarray, x: np.ndarray, y: np.ndarray, x0: float, y0: float, wanted: float
) -> float:
    """Largest radius <= `wanted` of a circle round (x0, y0) that stays clear of invalid points and of the border.

    `distance` (y, x): distance of each valid point to the next invalid one (see `distance_to_invalid`).
    """
    border = min(x0 - x[0], x[-1] - x0, y0 - y[0], y[-1] - y0)
    there = ndimage.map_coordinates(
        distance,
        [[(y0 - y[0]) / (y[1] - y[0])], [(x0 - x[0]) / (x[1] - x[0])]],
        order=1,
        mode="nearest",
    )[0]
    # one cell less, so that no interpolation touches an invalid point
    return float(min(wanted, border, there - max(x[1] - x[0], y[1] - y[0])))


def distance_to_invalid(valid: np.ndarray, dx: float, dy: float) -> np.ndarray:
    """Distance of every grid point to the nearest invalid one; infinite-like (1e30) where all are valid."""
    ok = np.asarray(valid).astype(bool)
    if ok.all():
        return np.full(ok.shape, 1e30)
    return ndimage.distance_transform_edt(ok, sampling=(dy, dx))


def contour_circulation(
    x: np.ndarray, y: np.ndarray, u: np.ndarray, v: np.ndarray, x0: float, y0: float, radius: float
) -> float:
    """Line integral of velocity round the circle, counter-clockwise; cubic interpolation of (y, x) fields."""
    n = max(64, int(np.ceil(8 * np.pi * radius / min(x[1] - x[0], y[1] - y[0]))))
    angle = np.arange(n) * 2 * np.pi / n
    at = _index(x, y, x0 + radius * np.cos(angle), y0 + radius * np.sin(angle))
    along = _at(v, at) * np.cos(angle) - _at(u, at) * np.sin(angle)
    return float(along.mean() * 2 * np.pi * radius)


def area_circulation(
    x: np.ndarray, y: np.ndarray, omega: np.ndarray, x0: float, y0: float, radius: float
) -> float:
    """Area integral of the vorticity (y, x) over the disc: Gauss-Legendre in radius, trapezoid in angle."""
    r, w = np.polynomial.legendre.leggauss(16)
    r, w = radius * (r + 1) / 2, w * radius / 2
    angle = np.arange(48) * 2 * np.pi / 48
    rr, aa = np.meshgrid(r, angle, indexing="ij")
    values = _at(omega, _index(x, y, x0 + rr * np.cos(aa), y0 + rr * np.sin(aa)))
    return float((w * r * values.mean(axis=1)).sum() * 2 * np.pi)


def _index(x: np.ndarray, y: np.ndarray, px: np.ndarray, py: np.ndarray) -> np.ndarray:
    return np.array([(py - y[0]) / (y[1] - y[0]), (px - x[0]) / (x[1] - x[0])])


def _at(field: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Cubic spline values on the part of the grid round the points; invalid points elsewhere do not matter."""
    low = np.maximum(np.floor(at.reshape(2, -1).min(axis=1)).astype(int) - 6, 0)
    high = np.ceil(at.reshape(2, -1).max(axis=1)).astype(int) + 7
    part = field[low[0] : high[0], low[1] : high[1]]
    shifted = at - low.reshape(2, *[1] * (at.ndim - 1))
    return ndimage.map_coordinates(np.nan_to_num(part), shifted, order=3, mode="mirror")
