"""What every reader of other programs' vectors gives: a regular grid, and what its file states."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

_SPELLINGS = {
    "pxs": "px",
    "px/fr": "px/frame",
    "px/dt": "px/frame",
    "m s-1": "m/s",
    "mm s-1": "mm/s",
}


@dataclass
class Vectors:
    """One instant as in the file: rows ordered by ascending y of the file.

    What the file does not state is None: `piv.foreign.read.to_plane` asks for it.
    """

    x: ndarray  # (nx,)
    y: ndarray  # (ny,)
    u: ndarray  # (ny, nx)
    v: ndarray
    flag: ndarray  # (ny, nx) uint8: 0 valid, 1 outlier, 2 masked
    length_unit: str | None = None  # "m", "mm", "px", ...
    velocity_unit: str | None = None  # "m/s", "mm/s", "px/frame", ...
    y_axis: str | None = None  # "up" or "down", of positions and of v alike
    time: float | None = None  # s
    scale_mm_per_px: float | None = None
    interval: float | None = None  # s between the exposures of a pair
    image_rows: int | None = None


def spelled(unit: str) -> str:
    """A unit in the words of this project."""
    unit = unit.strip().lower().replace("pixel", "px").replace("pix", "px")
    return _SPELLINGS.get(unit, unit)


Grid = tuple[ndarray, ndarray, ndarray, ndarray, ndarray]  # the first five of `Vectors`


def on_grid(path: Path, columns: Iterable[Any], flag: Any) -> Grid:
    """x, y, u, v of scattered vectors on a regular grid; what lacks there is masked (flag 2)."""
    x, y, u, v = (np.asarray(a, float).ravel() for a in columns)
    flag = np.asarray(flag).ravel().astype(np.uint8)
    if not np.isfinite(x).all() or not np.isfinite(y).all():
        raise ValueError(f"{path}: positions are not all finite numbers")
    axes = []
    for name, c in (("x", x), ("y", y)):
        values = np.unique(c)
        gaps = np.diff(values)
        if values.size < 2:
            raise ValueError(f"{path}: the vectors lie on one {name}; a plane needs at least two")
        step = float(np.median(gaps[gaps > 0.5 * gaps.max()]))
        n = round(float(values[-1] - values[0]) / step) + 1
        axis = np.linspace(values[0], values[-1], n)
        near = np.round((values - values[0]) / (axis[1] - axis[0])).astype(int)
        if n > 20 * values.size or np.abs(values - axis[near]).max() > 0.02 * step:
            raise ValueError(f"{path}: the {name} positions are not regularly spaced")
        axes.append((axis, np.round((c - values[0]) / (axis[1] - axis[0])).astype(int)))
    (xs, i), (ys, j) = axes
    if len(set(zip(j.tolist(), i.tolist(), strict=True))) < len(u):
        raise ValueError(
            f"{path}: several vectors have the same position; give one instant per file"
        )
    out_u, out_v = np.full((2, ys.size, xs.size), np.nan)
    out_flag = np.full((ys.size, xs.size), 2, np.uint8)
    out_u[j, i], out_v[j, i], out_flag[j, i] = u, v, flag
    out_flag[(out_flag == 0) & ~(np.isfinite(out_u) & np.isfinite(out_v))] = 1
    return xs, ys, out_u, out_v, out_flag
