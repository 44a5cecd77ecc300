"""Circulation round closed lines: line integrals of the velocity, which know no smoothing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy import ndarray
from scipy.interpolate import RegularGridInterpolator

from piv.formats.plane_series import usable
from piv.formats.recording import window_of

# of errors that are correlated by exp(-2 (d/L)²), along a line: their integral over d is this L
_CORRELATED = float(np.sqrt(np.pi / 2))
_CORNERS = 256  # of a circle; its polygon holds 1e-4 less area


class Circulation(NamedTuple):
    """Counter-clockwise circulation, its standard uncertainty, share of the line without vectors.

    NaN where the line passes places without vectors; the uncertainty also where vectors have none.
    """

    circulation: float
    std: float
    lost: float


def circle(x: float, y: float, radius: float) -> ndarray:
    """Corners (n, 2) of a circle."""
    angle = 2 * np.pi * np.arange(_CORNERS) / _CORNERS
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


def area(corners: ndarray) -> float:
    """Area of a polygon (n, 2)."""
    return abs(_signed_area(corners))


def _signed_area(corners: ndarray) -> float:
    x, y = corners.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def round_contour(plane: xr.Dataset, corners: ndarray) -> Circulation:
    """Circulation round a polygon (n, 2) of either sense in one plane (y, x).

    The line integral of bilinear velocities; its standard uncertainty to first order, errors of u
    and v independent, along the line correlated as of `piv derive`.
    """
    step = min(float(plane[axis][1] - plane[axis][0]) for axis in "xy")
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(*edges.T)
    counts = np.maximum(2, np.ceil(4 * lengths / step)).astype(int) * (lengths > 0)
    edge = np.repeat(np.arange(len(edges)), counts)
    part = (np.arange(edge.size) - np.repeat(np.cumsum(counts) - counts, counts) + 0.5) / counts[
        edge
    ]
    x, y = (corners[edge] + part[:, None] * edges[edge]).T
    along = np.sign(_signed_area(corners)) * edges[edge] / lengths[edge, None]
    ds = (lengths / np.maximum(counts, 1))[edge]
    ok = usable(plane)

    def sample(name: str) -> ndarray:
        return bilinear(plane[name].where(ok), x, y)

    flow = sample("u") * along[:, 0] + sample("v") * along[:, 1]
    lost = float(ds[~np.isfinite(flow)].sum() / ds.sum())
    std = np.nan
    if "u_std" in plane and "v_std" in plane:
        spread = (sample("u_std") * along[:, 0]) ** 2 + (sample("v_std") * along[:, 1]) ** 2
        std = float(np.sqrt(np.sum(spread * ds) * (_CORRELATED * window_of(plane) or step)))
    return Circulation(float(np.sum(flow * ds)), std, lost)


def bilinear(field: xr.DataArray, x: ndarray, y: ndarray) -> ndarray:
    """A field over (…, y, x) at points, as (…, point); NaN outside the grid."""
    grid = field["y"].values, field["x"].values
    values = field.transpose("y", "x", ...).values
    sample = RegularGridInterpolator(grid, values, bounds_error=False, fill_value=np.nan)
    return sample(np.column_stack([y, x])).T
