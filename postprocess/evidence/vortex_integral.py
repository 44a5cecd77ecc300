"""Circulation and centre of a vortex by integrals over a circle of a given radius: no shape of the core is assumed.

The fit of a Lamb-Oseen vortex leaves to the background what does not belong to a round core, so that its circulation
follows the core's size, which a coarse mesh widens; the integral counts all vorticity of the vortex's sense that is there.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from piv.vortices.circulation import distance_to_invalid
from piv.vortices.criteria import gradients, vorticity
from postprocess.evidence.fields import frame

CLEAR = 0.125  # tip widths (2 mm) from a body within which vorticity is its wall layer's, which has no part in the vortex
CIRCLE = 0.75  # tip widths: radius at which runs are compared; with half and one width errors differ by less than 1 % of
# the circulation (docs/mesh.md)


def vortex_integrals(
    plane: xr.Dataset, track: pd.DataFrame, radius: float, window: tuple[float, float]
) -> pd.DataFrame:
    """Integrals of the vorticity of the sense of a fitted `track` within `radius` (m) of its centre, over a window (s).

    What lies in the wall layer, within CLEAR of the body, is left out. Columns time, circulation (m²/s), x, y (m; centroid);
    rows are the instants of `plane` at which the track exists and its circle holds vorticity of its sense.
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
    """Circulation (m²/s) and centroid x, y (m) of the vorticity of the sense of `circulation` around a place (m), of a field `velocity`
    (2, y, x) on the `axes` x, y.

    None where nothing of it is within the circle and outside the wall layer.
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
    return (
        sense * total * abs(dx * dy),
        float(amount.sum(axis=0) @ x / total),
        float(amount.sum(axis=1) @ y / total),
    )
