"""Pressure on a body's outline, and the water's force and moment on it in the sheet."""

import numpy as np
import xarray as xr
from numpy import ndarray
from scipy.spatial import cKDTree

from piv.formats.plane_series import Planes
from piv.vortices.criteria import derivative

_NEAREST = 3  # points of the grid that a point of the outline follows
_AROUND = 10  # grid steps about the outline in which those are sought
_LEAST = 0.3  # of a grid step: nearer points weigh no more


class Shore:
    """The way from the pressure on a grid to that on an outline at one instant.

    x, y: axes, m. known: (y, x) bool, where the pressure is. outline: (finger, point, axis), m.
    wall_gradient: (finger, point, axis) Pa/m, that at the outline, known from its acceleration;
    None: that of the grid's pressure there alone.
    """

    def __init__(
        self,
        x: ndarray,
        y: ndarray,
        known: ndarray,
        outline: ndarray,
        wall_gradient: ndarray | None = None,
    ) -> None:
        self._step = float(x[1] - x[0]), float(y[1] - y[0])
        self._known, self._shape, self._wall = known, outline.shape[:2], wall_gradient
        points = outline.reshape(-1, 2)
        low, high = (limit(points, axis=0) for limit in (np.min, np.max))
        beside = (np.abs(c - (a + b) / 2) < (b - a) / 2 + _AROUND * step for c, a, b, step in
                  zip((x, y), low, high, self._step, strict=True))  # fmt: skip
        along_x, along_y = beside
        rows, columns = np.nonzero(known & along_x & along_y[:, None])
        if len(rows) < _NEAREST:
            raise ValueError("an outline lies where no pressure is known: is it in the view?")
        nodes = np.column_stack([x[columns], y[rows]])
        apart, near = cKDTree(nodes).query(points, k=_NEAREST)
        self._to = nodes[near] - points[:, None]
        # within the part of the grid that the gradient there needs
        (top, end), (left, right) = ((max(0, i.min() - 2), i.max() + 3) for i in (rows, columns))
        self._part = slice(top, end), slice(left, right)
        self._near = rows[near] - top, columns[near] - left
        self._far = apart[:, 0] > _AROUND * min(self._step)
        weights = np.maximum(apart, _LEAST * min(self._step)) ** -2.0
        self._weights = weights / weights.sum(axis=1, keepdims=True)

    def __call__(self, pressure: ndarray, errors: bool = False) -> ndarray:
        """Pressure (…, finger, point) from that on the grid (…, y, x), Pa.

        From each near point back along the mean of its gradient and the wall's. NaN farther than
        `_AROUND` grid steps from any, as outside the view. `errors`: of deviations, which the
        wall's known gradient does not have.
        """
        rows, columns = self._near
        pressure, known = pressure[..., *self._part], self._known[self._part]
        gradient = np.stack(
            [
                derivative(pressure, known, step, axis, "fourth-order")[..., rows, columns]
                for step, axis in zip(self._step, (1, 0), strict=True)
            ],
            axis=-1,
        )
        gradient = np.where(np.isfinite(gradient), gradient, 0.0)
        if self._wall is not None:
            wall = 0.0 if errors else self._wall.reshape(-1, 1, 2)
            gradient = 0.5 * (gradient + wall)
        back = pressure[..., rows, columns] - (gradient * self._to).sum(axis=-1)
        at = np.where(self._far, np.nan, (back * self._weights).sum(axis=-1))
        return at.reshape(*pressure.shape[:-2], *self._shape)


def wall_gradients(series: xr.Dataset, at: int, density: float) -> ndarray | None:
    """Pressure gradient (finger, point, axis) at the outline of instant `at`, Pa/m.

    Water at a wall has the wall's acceleration: central differences of `outline_velocity`. None
    where the series does not have it, or has one instant.
    """
    count = series.sizes["time"]
    if "outline_velocity" not in series or count < 2:
        return None
    ends = [max(at - 1, 0), min(at + 1, count - 1)]
    velocity = series["outline_velocity"].isel(time=ends).values
    return -density * np.diff(velocity, axis=0)[0] / float(np.diff(series["time"].values[ends])[0])


def loads(outline: ndarray, pressure: ndarray, about: ndarray) -> tuple[ndarray, ndarray]:
    """Force (…, finger, axis) N/m and moment (…, finger) N m/m of a pressure on closed outlines.

    outline: (finger, point, axis) m; pressure: (…, finger, point) Pa; about: (axis,) m, the point
    of the moment, counter-clockwise positive. Trapezoids; a constant pressure makes neither. NaN
    where a part of the outline has no pressure.
    """
    after = np.roll(outline, -1, axis=1)
    along, middle = after - outline, 0.5 * (after + outline) - about
    twice = (outline[..., 0] * after[..., 1] - after[..., 0] * outline[..., 1]).sum(axis=1)
    inward = np.stack([-along[..., 1], along[..., 0]], axis=-1) * np.sign(twice)[:, None, None]
    push = 0.5 * (pressure + np.roll(pressure, -1, axis=-1))[..., None] * inward
    moment = middle[..., 0] * push[..., 1] - middle[..., 1] * push[..., 0]
    return push.sum(axis=-2), moment.sum(axis=-1)


def line_loads(series: xr.Dataset, about: tuple[float, float], density: float) -> xr.Dataset:
    """Compute the pressure on outlines, its force and its moment.

    For a pressure that is known otherwise, as a simulation's in the sheet; `piv.pressure` gives
    them with their uncertainties.

    Parameters
    ----------
    series
        A series with `p` (Pa), `valid` and `outline` (m).
    about
        x, y of the moment's point, m.
    density
        kg/m³.

    Returns
    -------
    xarray.Dataset
        p_outline (Pa), line_force (N/m) and line_moment (N) over time.

    Raises
    ------
    ValueError
        Where the series has no pressure or outline.

    Examples
    --------
    >>> x, y = np.meshgrid(np.arange(-0.05, 0.055, 0.005), np.arange(-0.05, 0.055, 0.005))
    >>> t, zero = np.arange(2.0), np.zeros((2, 21, 21))
    >>> square = 0.02 * np.array([[[[-1, -1], [1, -1], [1, 1], [-1, 1]]]] * 2)
    >>> p = zero - 1e4 * y
    >>> series = piv.make_plane(x[0], y[:, 0], zero, zero, time=t, p=p, outline=square)
    >>> loads = piv.line_loads(series, (0, 0), 1000)  # of 1e4 Pa/m on 16 cm²: 16 N/m upwards
    >>> float(loads["line_force"][0, 0, 1].round(6))
    16.0
    """
    if missing := [name for name in ("p", "valid", "outline") if name not in series]:
        raise ValueError(f"line loads need the variable {missing[0]!r}, which the series lacks")
    found: list[tuple[ndarray, ...]] = []
    axes = series["x"].values, series["y"].values
    walls = series[[name for name in ("outline", "outline_velocity") if name in series]].load()
    planes = Planes(series[["p", "valid"]])
    for k in range(series.sizes["time"]):
        plane, outline = planes[k], walls["outline"][k].values
        p = plane["p"].values.astype(float)
        known = np.isfinite(p) & (plane["valid"].values != 0)
        at = Shore(*axes, known, outline, wall_gradients(walls, k, density))(p)
        found.append((at, *loads(outline, at, np.asarray(about))))
    p_outline, force, moment = (np.stack(part) for part in zip(*found, strict=True))
    return xr.Dataset(
        {
            "p_outline": (("time", "finger", "point"), p_outline),
            "line_force": (("time", "finger", "axis"), force),
            "line_moment": (("time", "finger"), moment),
        },
        coords={"time": series["time"]},
    )
