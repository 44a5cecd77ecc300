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
    x, y = plane["x"].values, plane["y"].values
    dx, dy = float(x[1] - x[0]), float(y[1] - y[0])
    times = plane["time"].values
    low, high = max(window[0], track["time"].iloc[0]), min(window[1], track["time"].iloc[-1])
    rows = []
    for index in np.flatnonzero((times >= low - 1e-9) & (times <= high + 1e-9)):
        (u, v), valid = frame(plane, int(index))
        x0, y0, fitted = (np.interp(times[index], track["time"], track[n]) for n in ("x", "y", "circulation"))
        sense = np.sign(fitted)
        omega = sense * vorticity(gradients(u, v, valid, dx, dy, "least-squares"))
        away = distance_to_invalid(valid, dx, dy) > CLEAR * float(plane.attrs["tip_width"])
        inside = np.hypot(x - x0, (y - y0)[:, None]) <= radius
        amount = np.where(inside & away & (omega > 0), omega, 0.0)
        total = amount.sum()
        if total == 0:
            continue  # nothing of the vortex is within the circle and outside the wall layer
        centroid = (amount.sum(axis=0) @ x, amount.sum(axis=1) @ y) / total
        rows.append([times[index], sense * total * abs(dx * dy), *centroid])
    return pd.DataFrame(rows, columns=["time", "circulation", "x", "y"])
