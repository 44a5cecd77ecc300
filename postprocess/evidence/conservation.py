"""What two mirrored fingers leave in the plane between them, against their walls and forces.

By Kelvin's theorem the circulation of the left half of the plane changes by what pressure and
motion of the walls shed into it, what is carried out of it, and what diffuses across x = 0; on a
symmetry plane that holds in three dimensions, too. The vertical impulse of the whole plane flow is
the momentum that the fingers gave it (Saffman, Vortex Dynamics, 1992, ch. 3).
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from piv.vortices.criteria import derivative, gradients, vorticity
from postprocess.evidence.centreline import beside_middle, crossings
from postprocess.evidence.fields import frame

# m below the upper end of a finger, where the contour round its half of the plane ends
_BELOW_ROOT = 0.005
_COLUMNS = ("time", "circulation", "walls", "pressure", "carried", "diffused")


def half_circulation(plane: xr.Dataset, density: float, viscosity: float) -> pd.DataFrame:
    """Circulation (m²/s) of the water in the left half of a plane series, and its parts over time.

    `circulation` is the line integral round that water, `walls` the finger's part of it. The rest
    has changed since the first instant by `pressure` (total head between the finger's two sides),
    `carried` (vorticity with the flow) and `diffused` (across x = 0): the four parts add up to
    `circulation` where everything is resolved. `viscosity` in m²/s.
    """
    x, y, times = plane["x"].values, plane["y"].values, plane["time"].values
    outline, velocity = (plane[n].isel(finger=0).values for n in ("outline", "outline_velocity"))
    top = int(np.searchsorted(y, min(y[-1], outline[..., 1].max() - _BELOW_ROOT) + 1e-9)) - 1
    columns, share = beside_middle(x)
    middle = columns.start + round(share)  # the column nearest to x = 0
    dx, dy = float(x[1] - x[0]), float(y[1] - y[0])
    rows = []
    for index, time in enumerate(times):
        (u, v), valid = frame(plane, index)
        ends = sides(valid[top], outline[index], x, y[top])
        left, above = _contour((u, v), x, y, top, middle, ends)
        omega = vorticity(gradients(u, v, valid, dx, dy))
        # u x omega along the path: omega (v dx - u dy)
        flux = _contour((omega * v, -omega * u), x, y, top, middle, ends)
        spread = derivative(omega, np.isfinite(omega), dx, 1, "least-squares")[: top + 1, middle]
        head = plane["p"].isel(time=index).values[top] / density + 0.5 * (u[top] ** 2 + v[top] ** 2)
        wall = wall_part(outline[index], velocity[index], y[top])
        rates = head[ends[0]] - head[ends[1]], flux[0] + flux[1], viscosity * np.nansum(spread) * dy
        rows.append([time, left + above + wall, wall, *rates])
    table = pd.DataFrame(rows, columns=list(_COLUMNS))
    for name in ("pressure", "carried", "diffused"):
        table[name] = running_integral(table[name].to_numpy(), times)
    # What is there at the first instant counts as shed by pressure.
    table["pressure"] += table["circulation"].iloc[0] - table["walls"].iloc[0]
    return table


def running_integral(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Integral over `time` from its first instant to each, by trapezes."""
    return np.concatenate([[0.0], np.cumsum(np.diff(time) * (values[1:] + values[:-1]) / 2)])


def sides(valid: np.ndarray, outline: np.ndarray, x: np.ndarray, height: float) -> tuple[int, int]:
    """The columns of water next to a finger's two sides at a height (m); `valid` (x) there."""
    at = crossings(outline, height)
    if not at.size:
        raise ValueError(f"no finger at a height of {height:.4f} m")
    water = np.flatnonzero(valid)
    return int(water[x[water] < at.min()][-1]), int(water[x[water] > at.max()][0])


def _contour(field, x, y, top: int, middle: int, ends: tuple[int, int]) -> tuple[float, float]:
    """∫ f·dl along left edge, bottom and x = 0, and along the top on either side of the finger.

    Counter-clockwise. `field`: components (y, x), where NaN counts as 0; `ends` as of `sides`.
    """
    along_x, along_y = (np.nan_to_num(part) for part in field)
    dx, dy = float(x[1] - x[0]), float(y[1] - y[0])
    down = -np.trapezoid(along_y[: top + 1, 0], dx=dy)
    bottom = np.trapezoid(along_x[0, : middle + 1], dx=dx)
    up = np.trapezoid(along_y[: top + 1, middle], dx=dy)
    above = np.trapezoid(along_x[top, ends[1] : middle + 1], dx=dx)
    above += np.trapezoid(along_x[top, : ends[0] + 1], dx=dx)
    return float(down + bottom + up), -float(above)


def wall_part(outline: np.ndarray, velocity: np.ndarray, height: float) -> float:
    """∫ u·dl (m²/s) along the outline (point, axis) below a height (m), the water on the left."""
    along = np.roll(outline, -1, axis=0) - outline
    mean = 0.5 * (velocity + np.roll(velocity, -1, axis=0))
    below = 0.5 * (outline[:, 1] + np.roll(outline[:, 1], -1)) < height
    x, y = outline.T
    # Counter-clockwise outlines have the water on their right.
    turn = np.sign(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    return -float(turn * (mean * along)[below].sum())


def vertical_impulse(plane: xr.Dataset) -> np.ndarray:
    """Vertical impulse (m³/s, per depth and density; downward negative) of a plane flow over time.

    ∫v − ∮x u·dl round the picture is −∫xω of the water with the vortex sheets at moving walls.
    """
    x, y = plane["x"].values, plane["y"].values
    dx, dy = float(x[1] - x[0]), float(y[1] - y[0])
    out = []
    for index in range(plane.sizes["time"]):
        (u, v), valid = frame(plane, index)
        u, v = np.where(valid, u, 0.0), np.where(valid, v, 0.0)
        edge = np.trapezoid(x * (u[0] - u[-1]), dx=dx)
        edge += np.trapezoid(x[-1] * v[:, -1] - x[0] * v[:, 0], dx=dy)
        out.append(np.trapezoid(np.trapezoid(v, dx=dx, axis=1), dx=dy) - edge)
    return np.array(out)
