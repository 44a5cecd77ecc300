"""Circulation and centre of a vortex by integrals over a circle: no shape of the core is assumed.

A fit's circulation follows the core's size, which a coarse mesh widens; the integral counts all
vorticity of the vortex's sense.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from piv.vortices.circulation import distance_to_invalid
from piv.vortices.criteria import gradients, vorticity
from postprocess.evidence.fields import frame

CLEAR = 0.125  # tip widths (2 mm) from a body: nearer, the vorticity is its wall layer's
# tip widths: radius at which runs are compared; half and one width differ by 1 % (docs/mesh.md)
CIRCLE = 0.75


def vortex_integrals(
    plane: xr.Dataset, track: pd.DataFrame, radius: float, window: tuple[float, float]
) -> pd.DataFrame:
    """Circulation (m²/s) and centroid x, y (m) over a window (s), with `time`, of a fitted `track`.

    Of the vorticity of the track's sense within `radius` (m) of its centre, but for the wall layer.
    Instants without any are left out.
    """
    times = plane["time"].values
    low, high = max(window[0], track["time"].iloc[0]), min(window[1], track["time"].iloc[-1])
    axes, width = (plane["x"].values, plane["y"].values), float(plane.attrs["tip_width"])
    rows = []
    for index in np.flatnonzero((times >= low - 1e-9) & (times <= high + 1e-9)):
        x0, y0, fitted = (
            float(np.interp(times[index], track["time"], track[n]))
            for n in ("x", "y", "circulation")
        )
        found = vortex_integral(axes, *frame(plane, int(index)), (x0, y0), fitted, radius, width)
        if found is not None:
            rows.append([times[index], *found])
    return pd.DataFrame(rows, columns=["time", "circulation", "x", "y"])


def vortex_integral(
    axes: tuple[np.ndarray, np.ndarray],
    velocity: np.ndarray,
    valid: np.ndarray,
    place: tuple[float, float],
    circulation: float,
    radius: float,
    tip_width: float,
) -> tuple[float, float, float] | None:
    """Circulation (m²/s) and centroid x, y (m) of the vorticity around a place (m).

    `velocity` (2, y, x) on the `axes` x, y; vorticity of the sense of `circulation` counts. None
    where nothing of it is within the circle and outside the wall layer.
    """
    x, y = axes
    dx, dy = float(x[1] - x[0]), float(y[1] - y[0])
    sense = float(np.sign(circulation))
    omega = sense * vorticity(gradients(velocity[0], velocity[1], valid, dx, dy, "least-squares"))
    away = distance_to_invalid(valid, dx, dy) > CLEAR * tip_width
    inside = np.hypot(x - place[0], (y - place[1])[:, None]) <= radius
    amount = np.where(inside & away & (omega > 0), omega, 0.0)
    total = float(amount.sum())
    if total == 0:
        return None
    centroid = float(amount.sum(axis=0) @ x / total), float(amount.sum(axis=1) @ y / total)
    return sense * total * abs(dx * dy), *centroid
