"""The vortex criterion Gamma2, in a module of its own because Numba is slow to import."""

from __future__ import annotations

import math

import numpy as np
from numpy import ndarray

from piv.compiled import compiled


def gamma2(u: ndarray, v: ndarray, valid: ndarray, dx: float, dy: float, radius: float) -> ndarray:
    """Gamma2 (y, x): mean sine of the angle between radius and relative velocity over a disc.

    `radius` in the grid's units. NaN where the point or half of its disc is invalid. |Gamma2| >
    2/pi marks points where rotation exceeds strain. Graftieux, Michard & Grosjean, Meas. Sci.
    Technol. 12 (2001), eq. 2.
    """
    reach_x, reach_y = (int(radius / step * (1 + 1e-9)) for step in (dx, dy))
    q, p = np.mgrid[-reach_y : reach_y + 1, -reach_x : reach_x + 1]
    disc = (p * dx) ** 2 + (q * dy) ** 2 <= radius**2 * (1 + 1e-9)
    return _gamma2(u, v, np.asarray(valid).astype(bool), q[disc], p[disc], dx, dy)


@compiled
def _gamma2(u, v, valid, rows, columns, dx, dy):
    """`gamma2` over the neighbours so many rows and columns away."""
    ny, nx = u.shape
    out = np.full((ny, nx), np.nan)
    for j in range(ny):
        for i in range(nx):
            if not valid[j, i]:
                continue
            count = 0
            um = vm = 0.0
            for k in range(rows.size):
                r, c = j + rows[k], i + columns[k]
                if 0 <= r < ny and 0 <= c < nx and valid[r, c]:
                    count += 1
                    um += u[r, c]
                    vm += v[r, c]
            if 2 * count <= rows.size or count < 5:
                continue
            um, vm = um / count, vm / count
            sine = 0.0
            for k in range(rows.size):
                r, c = j + rows[k], i + columns[k]
                if 0 <= r < ny and 0 <= c < nx and valid[r, c]:
                    rx, ry = columns[k] * dx, rows[k] * dy
                    a, b = u[r, c] - um, v[r, c] - vm
                    size = math.sqrt((a * a + b * b) * (rx * rx + ry * ry))
                    if size > 0:
                        sine += (rx * b - ry * a) / size
            out[j, i] = sine / (count - 1)
    return out
