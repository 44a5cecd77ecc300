"""A plane series as a smooth velocity field: cubic B-spline in space, cubic Hermite in time."""

import math
from collections import OrderedDict

import numba
import numpy as np
import xarray as xr
from numpy import ndarray
from scipy import ndimage
from scipy.spatial import KDTree

from piv.compiled import compiled, fast
from piv.formats.plane_series import VECTORS, Planes, check_vectors, usable

USED = (*VECTORS, "w", "dwdz", "outline", "outline_velocity")
CACHED_PLANES = 6
# a step's end is the next one's beginning, and both its truth and its speed are needed
CACHED_INSTANTS = 3
# cells into a body that take its surface's velocity; further in, no particle ever is
BODY_REACH = 8.0


class PlaneField:
    """Velocity (u, v, w, dwdz) of a plane series at any point and instant, read lazily.

    Only a few planes are in memory at once. Where the plane has no vectors (bodies, rejected) the
    field is continued for interpolation only: with the velocity of a body's surface where the plane
    gives it (`outline_velocity`; the water sticks to it), else from its neighbours (`extend`).
    Outside the plane the border value holds. Where nothing crosses the sheet (w is there, and zero
    everywhere) dwdz is what continuity demands of u and v as they are interpolated: any other value
    would thin particles out, or heap them up, wherever they stay long, as in a vortex' core.
    """

    def __init__(self, series: xr.Dataset) -> None:
        if "time" not in series["u"].dims or series.sizes["time"] < 2:
            raise ValueError(
                "a recording is rendered from a plane series with at least two instants of 'time'"
            )
        self._planes = Planes(series[[name for name in USED if name in series]])
        self.time = series["time"].values.astype(float)
        self.x, self.y = series["x"].values, series["y"].values
        self.dx, self.dy = float(np.mean(np.diff(self.x))), float(np.mean(np.diff(self.y)))
        self._cache: OrderedDict[int, ndarray] = OrderedDict()
        self._instants: OrderedDict[float, ndarray] = OrderedDict()

    def plane(self, i: int) -> ndarray:
        """Spline coefficients (y, x, component u v w dwdz) of instant `i`, mirrored by one node."""
        if i not in self._cache:
            now = self._planes[i]
            check_vectors(now)
            present = usable(now).values
            if not present.any():
                raise ValueError(f"the plane at time {self.time[i]:g} s has no usable vector")
            body = self._body_velocity(now, ~present)
            out = np.zeros((present.shape[0] + 2, present.shape[1] + 2, 4))
            plane = "w" in now and not np.any(now["w"].values[present])
            for k, name in enumerate(("u", "v") if plane else ("u", "v", "w", "dwdz")):
                if name in now:
                    values = now[name].values.astype(float)
                    known = present & np.isfinite(values)
                    if body is not None and name in body:
                        values = np.where(present, values, body[name])
                        known |= np.isfinite(body[name])
                    filled = extend(values, known)
                    out[..., k] = _coefficients(filled)
            if plane:
                outward = np.where(
                    present, divergence(out[..., 0], out[..., 1], self.dx, self.dy), 0.0
                )
                out[..., 3] = _coefficients(-outward)
            self._cache[i] = out
            if len(self._cache) > CACHED_PLANES:
                self._cache.popitem(last=False)
        return self._cache[i]

    def _body_velocity(self, now: xr.Dataset, absent: ndarray) -> dict[str, ndarray] | None:
        """Velocity u, v of the nearest outline point at nodes within bodies, else NaN; or None."""
        if "outline_velocity" not in now:
            return None
        points = now["outline"].values.reshape(-1, 2)
        velocity = now["outline_velocity"].values.reshape(-1, 2)
        y, x = np.nonzero(absent)
        away, nearest = KDTree(points).query(np.column_stack([self.x[x], self.y[y]]))
        inside = away < BODY_REACH * max(self.dx, self.dy)
        y, x, nearest = y[inside], x[inside], nearest[inside]
        components = {}
        for k, name in enumerate(("u", "v")):
            components[name] = np.full(absent.shape, np.nan)
            components[name][y, x] = velocity[nearest, k]
        return components

    def at(self, t: float) -> ndarray:
        """Spline coefficients as of `plane` at time `t`, C1 in t; to be read only."""
        if t not in self._instants:
            (first, w), *others = _hermite_weights(self.time, t)
            out = w * self.plane(first)
            for i, w in others:
                out += w * self.plane(i)
            self._instants[t] = out
            if len(self._instants) > CACHED_INSTANTS:
                self._instants.popitem(last=False)
        self._instants.move_to_end(t)
        return self._instants[t]

    def sample(self, coefficients: ndarray, x: ndarray, y: ndarray) -> ndarray:
        """Values (component, point) of `coefficients` at points in m."""
        return _sample(
            coefficients, (np.ravel(x) - self.x[0]) / self.dx, (np.ravel(y) - self.y[0]) / self.dy
        )


@fast
def extremes(c, per_x, per_y):
    """Largest magnitudes in a plane's coefficients: u, v, w, dwdz, slope and curvature.

    c: as `PlaneField.at` gives them; per_x, per_y: nodes per metre.
    """
    ny, nx, _ = c.shape
    u = v = w = dwdz = slope = curvature = 0.0
    for j in range(1, ny - 1):
        for i in range(1, nx - 1):
            u, v = max(u, abs(c[j, i, 0])), max(v, abs(c[j, i, 1]))
            w, dwdz = max(w, abs(c[j, i, 2])), max(dwdz, abs(c[j, i, 3]))
            for k in range(2):
                here = c[j, i, k]
                left, right = here - c[j, i - 1, k], c[j, i + 1, k] - here
                down, up = here - c[j - 1, i, k], c[j + 1, i, k] - here
                slope = max(slope, abs(right) * per_x, abs(up) * per_y)
                curvature = max(curvature, abs(right - left) * per_x**2, abs(up - down) * per_y**2)
    return u, v, w, dwdz, slope, curvature


def _coefficients(values: ndarray) -> ndarray:
    return np.pad(ndimage.spline_filter(values, order=3, mode="mirror"), 1, mode="reflect")


def _hermite_weights(time: ndarray, t: float) -> list[tuple[int, float]]:
    """Weights of the nodes round `t` of the C1 cubic Hermite interpolant with parabola slopes."""
    i = int(np.clip(np.searchsorted(time, t, side="right") - 1, 0, time.size - 2))
    h = time[i + 1] - time[i]
    s = min(max((t - time[i]) / h, 0.0), 1.0)
    weights = {i: (1 + 2 * s) * (1 - s) ** 2, i + 1: s * s * (3 - 2 * s)}
    for node, basis in ((i, s * (1 - s) ** 2 * h), (i + 1, s * s * (s - 1) * h)):
        for k, slope in _slope(time, node):
            weights[k] = weights.get(k, 0.0) + basis * slope
    return [(k, w) for k, w in weights.items() if w != 0.0]


def _slope(time: ndarray, i: int) -> list[tuple[int, float]]:
    """Derivative weights at node i of the parabola through it and its neighbours."""
    if i == 0 or i == time.size - 1:
        j = min(i, time.size - 2)
        h = time[j + 1] - time[j]
        return [(j, -1 / h), (j + 1, 1 / h)]
    a, b = time[i] - time[i - 1], time[i + 1] - time[i]
    return [(i - 1, -b / (a * (a + b))), (i, (b - a) / (a * b)), (i + 1, a / (b * (a + b)))]


def divergence(u: ndarray, v: ndarray, dx: float, dy: float) -> ndarray:
    """∂u/∂x + ∂v/∂y at the nodes (y, x) of two cubic B-splines with one node more per side."""
    across = (u[:, 2:] - u[:, :-2]) / (2 * dx)
    upward = (v[2:] - v[:-2]) / (2 * dy)
    mean = (1 / 6, 2 / 3, 1 / 6)
    return (
        mean[0] * across[:-2] + mean[1] * across[1:-1] + mean[2] * across[2:]
        + mean[0] * upward[:, :-2] + mean[1] * upward[:, 1:-1] + mean[2] * upward[:, 2:]
    )  # fmt: skip


def extend(values: ndarray, known: ndarray) -> ndarray:
    """Continue `values` (y, x) over unknown nodes: linear for three cells, then constant.

    For interpolation near bodies only; layer by layer, by weighted least squares over the known 5 x
    5 neighbours.
    """
    out = np.where(known, values, 0.0)
    if known.all():
        return out
    have = known.copy()
    for layer in range(4):
        new = ndimage.binary_dilation(have, np.ones((3, 3), bool)) & ~have
        if not new.any():
            return out
        j, i = np.nonzero(new)
        out[j, i] = _continue(out, have, j, i, 2 if layer < 3 else 1)
        have |= new
    j, i = ndimage.distance_transform_edt(~have, return_distances=False, return_indices=True)
    return out[j, i]


@compiled
def _continue(values, have, jj, ii, reach):
    ny, nx = values.shape
    out = np.empty(jj.size)
    for n in range(jj.size):
        a = np.zeros((3, 3))
        b = np.zeros(3)
        for j in range(max(0, jj[n] - 2), min(ny, jj[n] + 3)):
            for i in range(max(0, ii[n] - 2), min(nx, ii[n] + 3)):
                if have[j, i]:
                    basis = (1.0, float(i - ii[n]), float(j - jj[n]))
                    w = math.exp(-0.5 * (basis[1] ** 2 + basis[2] ** 2))
                    for p in range(3):
                        b[p] += w * basis[p] * values[j, i]
                        for q in range(3):
                            a[p, q] += w * basis[p] * basis[q]
        mean = b[0] / a[0, 0]
        out[n] = mean
        if reach == 2:
            for p in (1, 2):  # damps the slope where the neighbours do not determine it
                a[p, p] += 0.05 * a[0, 0]
            out[n] = np.linalg.solve(a, b)[0]
    return out


@numba.njit(cache=True, inline="always")
def _spline_weights(s):
    """Weights of the four cubic B-splines at fraction `s` of a cell."""
    r = 1.0 - s
    return r * r * r / 6, 2 / 3 - s * s * (2 - s) / 2, 2 / 3 - r * r * (2 - r) / 2, s * s * s / 6


@compiled
def sample_point(c, gx, gy):
    """The four components at grid position (gx, gy); the border value holds outside."""
    ny, nx = c.shape[0] - 2, c.shape[1] - 2
    gx, gy = min(max(gx, 0.0), nx - 1.0), min(max(gy, 0.0), ny - 1.0)
    i, j = min(int(gx), nx - 2), min(int(gy), ny - 2)
    wx, wy = _spline_weights(gx - i), _spline_weights(gy - j)
    a0 = a1 = a2 = a3 = 0.0
    # unsigned: a signed index would be tested for being negative 64 times
    row, column = np.uint64(j), np.uint64(i)
    for q in range(4):
        r = row + np.uint64(q)
        b0 = b1 = b2 = b3 = 0.0
        for p in range(4):
            k, w = column + np.uint64(p), wx[p]
            b0 += w * c[r, k, np.uint64(0)]
            b1 += w * c[r, k, np.uint64(1)]
            b2 += w * c[r, k, np.uint64(2)]
            b3 += w * c[r, k, np.uint64(3)]
        w = wy[q]
        a0, a1, a2, a3 = a0 + w * b0, a1 + w * b1, a2 + w * b2, a3 + w * b3
    return a0, a1, a2, a3


@compiled
def _sample(c, gx, gy):
    out = np.empty((4, gx.size))
    for n in range(gx.size):
        out[0, n], out[1, n], out[2, n], out[3, n] = sample_point(c, gx[n], gy[n])
    return out
