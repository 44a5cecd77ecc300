"""Circulation of a plane field round a circle: line and area integrals."""

from __future__ import annotations

import numpy as np
from numpy import ndarray
from scipy import ndimage


def clear_radius(
    distance: ndarray, x: ndarray, y: ndarray, x0: float, y0: float, wanted: float
) -> float:
    """Largest radius <= `wanted` of a circle round (x0, y0) clear of invalid points and border.

    `distance` (y, x): distance of each valid point to the next invalid one (see
    `distance_to_invalid`).
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


def distance_to_invalid(valid: ndarray, dx: float, dy: float) -> ndarray:
    """Distance of every grid point to the nearest invalid one; 1e30 where all are valid."""
    ok = np.asarray(valid).astype(bool)
    if ok.all():
        return np.full(ok.shape, 1e30)
    return ndimage.distance_transform_edt(ok, sampling=(dy, dx))


def contour_circulation(
    x: ndarray, y: ndarray, u: ndarray, v: ndarray, x0: float, y0: float, radius: float
) -> float:
    """Line integral of velocity round the circle, counter-clockwise; cubic interpolation."""
    n = max(64, int(np.ceil(8 * np.pi * radius / min(x[1] - x[0], y[1] - y[0]))))
    angle = np.arange(n) * 2 * np.pi / n
    at = _index(x, y, x0 + radius * np.cos(angle), y0 + radius * np.sin(angle))
    along = _at(v, at) * np.cos(angle) - _at(u, at) * np.sin(angle)
    return float(along.mean() * 2 * np.pi * radius)


def area_circulation(
    x: ndarray, y: ndarray, omega: ndarray, x0: float, y0: float, radius: float
) -> float:
    """Area integral of the vorticity (y, x) over the disc: Gauss-Legendre by trapezoid."""
    r, w = np.polynomial.legendre.leggauss(16)
    r, w = radius * (r + 1) / 2, w * radius / 2
    angle = np.arange(48) * 2 * np.pi / 48
    rr, aa = np.meshgrid(r, angle, indexing="ij")
    values = _at(omega, _index(x, y, x0 + rr * np.cos(aa), y0 + rr * np.sin(aa)))
    return float((w * r * values.mean(axis=1)).sum() * 2 * np.pi)


def _index(x: ndarray, y: ndarray, px: ndarray, py: ndarray) -> ndarray:
    return np.array([(py - y[0]) / (y[1] - y[0]), (px - x[0]) / (x[1] - x[0])])


def _at(field: ndarray, at: ndarray) -> ndarray:
    """Cubic spline values on the part of the grid round the points."""
    low = np.maximum(np.floor(at.reshape(2, -1).min(axis=1)).astype(int) - 6, 0)
    high = np.ceil(at.reshape(2, -1).max(axis=1)).astype(int) + 7
    part = field[low[0] : high[0], low[1] : high[1]]
    shifted = at - low.reshape(2, *[1] * (at.ndim - 1))
    return ndimage.map_coordinates(np.nan_to_num(part), shifted, order=3, mode="mirror")
