"""Vectors and what is derived from them along a straight line."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
import xarray as xr

from piv.fields.blocks import blocks, fields_of
from piv.formats.plane_series import usable
from piv.vortices.contour import bilinear

_SKIPPED = ("valid", "flag", "n")  # no quantities to interpolate


def along_line(
    plane: xr.Dataset,
    start: tuple[float, float],
    end: tuple[float, float],
    points: int | None = None,
) -> Iterator[pd.DataFrame]:
    """Every field at `points` along the line, in parts along time.

    Columns: time (of a series), s (distance from the start), x, y, the fields, along and across.

    Bilinear between grid points; absent where one of the four is. Of standard uncertainties the
    interpolated value is an upper bound. along, across: velocity in the line's direction and to its
    left. points None: one per grid step.
    """
    (x0, y0), (x1, y1) = start, end
    length = float(np.hypot(x1 - x0, y1 - y0))
    step = min(float(plane[n][1] - plane[n][0]) for n in ("x", "y"))
    if not length > 0:
        raise ValueError("the line has no length: give two different points")
    for name, ends in (("x", (x0, x1)), ("y", (y0, y1))):
        low, high = float(plane[name][0]), float(plane[name][-1])
        if not all(low - 1e-9 * step <= e <= high + 1e-9 * step for e in ends):
            raise ValueError(f"the line leaves the plane: {name} runs from {low:g} to {high:g}")
    count = points or max(2, round(length / step) + 1)
    if count < 2:
        raise ValueError(f"a line has at least 2 points, got {count}")
    s = np.linspace(0, length, count)
    way = {"x": x0 + s / length * (x1 - x0), "y": y0 + s / length * (y1 - y0)}
    # rounding must not leave the plane
    x, y = (np.clip(c, *plane[name].values[[0, -1]]) for name, c in way.items())
    names = [n for n in fields_of(plane) if n not in _SKIPPED]
    for part in blocks(plane):
        ok = usable(part)
        samples = {n: bilinear(part[n].where(ok), x, y) for n in names}
        table = {"s": s, "x": x, "y": y} | samples
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        table["along"], table["across"] = (
            table["u"] * ux + table["v"] * uy,
            table["v"] * ux - table["u"] * uy,
        )
        for k, time in enumerate(part["time"].values):
            rows = pd.DataFrame({n: v[k] if np.ndim(v) == 2 else v for n, v in table.items()})
            if "time" in plane["u"].dims:
                rows.insert(0, "time", float(time))
            yield rows
