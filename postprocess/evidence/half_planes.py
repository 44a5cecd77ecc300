"""Two mirrored fingers by integrals of each half of the plane, and the jet at fixed distances.

Per unit depth and density; impulse of a plane flow: Saffman, Vortex Dynamics (1992), 3.2.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from scipy import ndimage

from piv.vortices.criteria import gradients, vorticity
from postprocess.evidence.centreline import beside_middle, halves_of, on_middle
from postprocess.evidence.fields import frame

CLEAR = 0.125  # tip widths (2 mm) from a body: nearer, the vorticity is its wall layer's
# m below the tips where they are nearest: places at which the jet is measured
BELOW = (0.020, 0.030, 0.040)


def names_at(depth: float) -> tuple[str, str]:
    """Columns of the jet's speed (m/s) and momentum flux (m³/s²) at a depth (m) below the tips."""
    return f"jet_speed_{depth * 1e3:.0f}mm", f"jet_flux_{depth * 1e3:.0f}mm"


def half_planes(plane: xr.Dataset) -> pd.DataFrame:
    """Integrals of a plane series of two fingers, a row per instant.

    Of either half (_0 left, _1 right) `circulation` (m²/s) and vertical `impulse` (m³/s, −∫xω) of
    the vorticity farther than CLEAR from a body; by `names_at` the jet on x = 0 and its flux ∫v².
    """
    x, y, width = plane["x"].values, plane["y"].values, float(plane.attrs["tip_width"])
    dx, dy = float(x[1] - x[0]), float(y[1] - y[0])
    tips = plane["tip"].values
    nearest = int(np.argmin(np.abs(tips[..., 0]).sum(axis=1)))
    heights = tips[nearest, :, 1].mean() - np.array(BELOW)
    rows = []
    for index, time in enumerate(plane["time"].values):
        (u, v), valid = frame(plane, index)
        omega = np.nan_to_num(vorticity(gradients(u, v, valid, dx, dy, "least-squares")))
        if not valid.all():
            away = ndimage.distance_transform_edt(valid, sampling=(dy, dx)) > CLEAR * width
            omega = np.where(away, omega, 0.0)
        row = {"time": time}
        for finger, half in enumerate(halves_of(x)):
            part = omega[:, half].sum(axis=0) * dx * dy
            row[f"circulation_{finger}"] = part.sum()
            row[f"impulse_{finger}"] = -(x[half] * part).sum()
        for depth, height in zip(BELOW, heights, strict=True):
            jet = jet_at(np.where(valid, v, np.nan), x, y, height)
            row |= zip(names_at(depth), jet, strict=True)
        rows.append(row)
    return pd.DataFrame(rows)


def jet_at(v: np.ndarray, x: np.ndarray, y: np.ndarray, height: float) -> tuple[float, float]:
    """Downward speed (m/s) on x = 0 and flux ∫v² dx (m³/s²) of the stream round it at a height (m).

    `v` (y, x), NaN where unknown. 0 where the flow is up, NaN where it is not known.
    """
    if not y[0] <= height <= y[-1]:
        return np.nan, np.nan
    after = int(np.clip(np.searchsorted(y, height), 1, y.size - 1))
    share = (height - y[after - 1]) / (y[after] - y[after - 1])
    down = -((1 - share) * v[after - 1] + share * v[after])
    columns, part = beside_middle(x)
    speed = float(on_middle(down[columns], part))
    if not speed > 0:
        return (0.0, 0.0) if speed <= 0 else (np.nan, np.nan)
    stops = np.flatnonzero(~(down > 0))  # unknown ends the stream, too
    first = max((k + 1 for k in stops if x[k] < 0), default=0)
    last = min((k for k in stops if x[k] >= 0), default=x.size)
    return speed, float((down[first:last] ** 2).sum() * (x[1] - x[0]))
