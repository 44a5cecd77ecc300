"""The flow along the trace of the finger: where it has passed and water is now."""

import numpy as np
import xarray as xr

from piv.images.masks import inside_polygon
from postprocess.evidence.fields import frame


def trace_velocity(
    plane: xr.Dataset, window: tuple[float, float], finger: int, since: float = 0.0
) -> tuple[float, float]:
    """Mean upward velocity (m/s) and share of rising points on the trace, over a window (s).

    The trace is every grid point that was inside the finger at an earlier instant, from `since`
    (s) on, and is measured now. ValueError where the trace is empty.
    """
    if "outline" not in plane:
        raise ValueError("the plane series has no outline of the finger, so its trace is not known")
    x, y, times = plane["x"].values, plane["y"].values, plane["time"].values
    passed = np.zeros((y.size, x.size), bool)
    total, rising, points = 0.0, 0, 0
    for index in np.flatnonzero((times >= since) & (times <= window[1])):
        if times[index] >= window[0]:
            field, valid = frame(plane, int(index))
            upward = field[1][passed & valid]
            total += upward.sum()
            rising += int((upward > 0).sum())
            points += upward.size
        passed |= inside_polygon(plane["outline"].values[index, finger], x, y)
    if points == 0:
        raise ValueError(
            f"the finger leaves no trace between {window[0]:.3f} and {window[1]:.3f} s"
        )
    return float(total / points), rising / points
