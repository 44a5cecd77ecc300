"""Circulation and swirl over the distance from a point."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
import xarray as xr

from piv.fields.blocks import blocks
from piv.vortices.contour import circle, round_contour


def around(
    series: xr.Dataset,
    centre: tuple[float, float],
    radius: float | None = None,
    points: int | None = None,
) -> Iterator[pd.DataFrame]:
    """Circulation on circles about `centre`, a table per instant.

    Columns: time (of a series), r, circulation, circulation_std (NaN where vectors have none),
    swirl (mean velocity along the circle). NaN where a circle passes places without vectors.
    `radius` of the largest, None: to the plane's nearest border; `points` circles, None: one per
    grid step. ValueError where the circles leave the plane.
    """
    low, high = (np.array([float(series[axis][end]) for axis in "xy"]) for end in (0, -1))
    room = float(np.min([np.array(centre) - low, high - np.array(centre)]))
    step = min(float(series[axis][1] - series[axis][0]) for axis in "xy")
    largest = room if radius is None else radius
    if not 0 < largest <= room * (1 + 1e-9):
        raise ValueError(
            f"the circles leave the plane, x from {low[0]:g} to {high[0]:g} and y from {low[1]:g}"
            f" to {high[1]:g}: give another centre, or a radius up to {max(room, 0.0):.4g}"
        )
    count = points or max(1, round(largest / step))
    if count < 1:
        raise ValueError(f"give at least 1 circle, got {count}")
    radii = largest * np.arange(1, count + 1) / count
    for part in blocks(series):
        for k, time in enumerate(part["time"].values):
            plane = part.isel(time=k).assign_attrs(series.attrs)
            found = [round_contour(plane, circle(*centre, r)) for r in radii]
            rows = pd.DataFrame(
                {
                    "r": radii,
                    "circulation": [c.circulation for c in found],
                    "circulation_std": [c.std for c in found],
                }
            )
            rows["swirl"] = rows["circulation"] / (2 * np.pi * radii)
            if "time" in series["u"].dims:
                rows.insert(0, "time", float(time))
            yield rows
