"""Pressure of the water in the light sheet from vectors over time, with its uncertainty."""

from functools import lru_cache, partial
from typing import Any

import numpy as np
import xarray as xr
from numpy import ndarray
from scipy.ndimage import gaussian_filter

from piv.formats.plane_series import AXES, UNITS, VECTORS, Planes, absent, usable
from piv.formats.recording import window_of
from piv.momentum.acceleration import REACHES, Field, Flow, acceleration, time_slope
from piv.momentum.integrate import Integral, Links, links
from piv.momentum.outline import Shore, loads, wall_gradients
from piv.vortices.criteria import gradients

WATER = 998.2, 1.004e-6  # kg/m³ and m²/s at 20 °C
SAMPLES = 12  # of errors, which give standard uncertainties to a fifth
WINDOW = 2.0  # grid steps, where the series does not state it: that of an overlap of a half
_MODEL_LENGTH = 20.0  # grid steps over which errors of the balance hang together
_SHARE = 0.04  # of the pressure, chosen: what windows take without a trace
_ROUNDS = 6  # of the fit of two variances, which then stands still
LEAST = 1e-6  # m/s: no vector is better known
REFERENCE = "mean over the edge of the view is 0"


def pressure(
    series: xr.Dataset,
    *,
    density: float = WATER[0],
    viscosity: float = WATER[1],
    about: tuple[float, float] = (0.0, 0.0),
) -> xr.Dataset:
    """Compute the pressure of the water from vectors over time, and its loads on outlines.

    Method as of `Balance`; all in memory.

    Parameters
    ----------
    series
        A plane series in SI.
    density
        kg/m³.
    viscosity
        Kinematic, m²/s.
    about
        x, y of the moment's point, m.

    Returns
    -------
    xarray.Dataset
        The series with p, p_std (Pa) and, with an outline, the loads.

    Raises
    ------
    ValueError
        Where the series is not in SI or too short.

    Examples
    --------
    >>> x = np.arange(-0.05, 0.055, 0.005)
    >>> u = np.ones((5, 21, 21)) * 2 * np.arange(0, 0.5, 0.1)[:, None, None]  # 2 m/s² along x
    >>> series = piv.make_plane(x, x, u, 0 * u, time=np.arange(0, 0.5, 0.1))
    >>> p = piv.pressure(series, density=1000)["p"][2]
    >>> float((p[10, -1] - p[10, 0]) / (x[-1] - x[0])).__round__()  # Pa/m
    -2000
    """
    balance = Balance(series, density, viscosity, about)
    rows = [balance.at(k) for k in range(series.sizes["time"])]
    made = {name: values_of(name, np.stack([row[name] for row in rows])) for name in rows[0]}
    return series.assign(made).assign_attrs(balance.attributes)


def values_of(name: str, values: ndarray) -> xr.Variable:
    """What `Balance.at` gives, as a variable over time of a plane series."""
    grid = AXES[name][1:] == ("y", "x")
    return xr.Variable(
        AXES[name], values.astype(np.float32) if grid else values, {"units": UNITS[name]}
    )


class Balance:
    """The momentum of a series' instants.

    density: kg/m³; viscosity: kinematic, m²/s; about: the moment's point, m.

    In a plane that the flow does not cross, grad p = -density (Du/Dt - viscosity lap u), with the
    in-plane part of the Laplacian. p is the least-squares fit to that gradient over all links
    between neighbours. A link's variance is a² N + b² S: N of the vectors' own uncertainty
    through the difference formulas, S the squared velocity gradient, for what the balance lacks
    where the flow is strained; a and b are such that the fit's residuals have these variances.
    p_std: the standard deviation of `SAMPLES` random errors of both kinds, sent through the same
    fit and scaled by the same residuals, what the time derivative lacks, and `_SHARE` of p. Source
    of the method: van Oudheusden, Meas. Sci. Technol. 24, 032001 (2013).
    """

    def __init__(
        self, series: xr.Dataset, density: float, viscosity: float, about: tuple[float, float]
    ) -> None:
        _check(series, density, viscosity)
        used = [n for n in (*VECTORS, "outline", "outline_velocity") if n in series]
        walls = [name for name in used if name.startswith("outline")]
        self._walls = series[walls].load()
        self._density, self._viscosity = density, viscosity
        planes = Planes(series[[name for name in used if name not in walls]])
        self._absent = absent(series)
        self._about = np.asarray(about, dtype=float)
        self._x, self._y, self._times = (series[name].values for name in ("x", "y", "time"))
        self._steps = float(np.diff(self._x[:2])[0]), float(np.diff(self._y[:2])[0])
        self._window = window_of(series) / self._steps[0] or WINDOW
        shape = (2, SAMPLES, len(self._y), len(self._x))
        # of unit variance, the same at every instant: of one field, of others, of the balance
        self._errors = tuple(
            _errors(seed, shape, length)
            for seed, length in enumerate((self._window, self._window, _MODEL_LENGTH))
        )
        self._fields = lru_cache(maxsize=2 * REACHES[-1] + 1)(partial(_field, planes))
        wall = len(walls) == 2
        self.attributes: dict[str, Any] = {  # what a file says of the pressure in it
            "density": density,
            "kinematic_viscosity": viscosity,
            "pressure_reference": REFERENCE,
            "pressure_boundary": (
                "on the outline the gradient of its acceleration; elsewhere none"
                if wall
                else "none: free at masks and at the edge of the view"
            ),
            "moment_about": list(about),
        }

    def at(self, k: int) -> dict[str, ndarray]:
        """`p`, `p_std` (y, x) Pa, and with an outline its pressure and loads, of instant `k`."""
        now = self._fields(k)
        if self._absent[k]:
            return self._nothing()
        few = ValueError(f"no pressure at {self._times[k]:g} s: too few usable vectors")
        if not now.ok.any():
            raise few
        slope = time_slope(self._times, k, self._fields, self._window)
        (u, v), (dx, dy) = now.velocity, self._steps
        flow = Flow(u, v, now.ok, dx, dy, self._viscosity)
        rates = acceleration(flow, slope.value, u, v)
        good = now.ok & np.isfinite(rates).all(axis=0)
        if good.sum() < 2:
            raise few
        net = links(good, dx, dy)
        reach = -self._density * net.steps  # from accelerations to differences of pressure
        g = gradients(u, v, now.ok, dx, dy, "fourth-order")
        strain = _near(sum(np.square(part) for part in g), good)
        faced = (u / dx) ** 2 + (v / dy) ** 2 + strain
        own = (slope.variance + np.square(now.std) * faced).sum(axis=0)
        parts = [reach**2 * net.middle(part) for part in (own, strain)]
        fit = _weighted(net, reach * net.middle(*rates), parts)
        p, off = fit(reach * net.middle(*rates))

        of_now, of_others, of_balance = self._errors
        of_now = of_now * now.std[:, None]
        share = slope.weights[k - slope.near.start]  # of this field in its derivative
        others = np.sqrt(np.maximum(slope.variance - np.square(share * now.std), 0.0))
        du, dv = of_now
        of_noise = acceleration(flow, share * of_now + others[:, None] * of_others, du, dv)
        of_noise += np.stack([du * g.dudx + dv * g.dudy, du * g.dvdx + dv * g.dvdy])
        kinds = of_noise, of_balance * np.sqrt(strain)
        errors, offs = zip(*(fit(reach * net.middle(*kind)) for kind in kinds), strict=True)
        shares = _two_variances(
            off**2,
            [np.mean(np.square(sampled), axis=0) for sampled in offs],
            [part / fit.variance**2 for part in parts],
        )
        known = [np.sqrt(s / SAMPLES) * e for s, e in zip(shares, errors, strict=True)]
        scaled = np.concatenate([*known, fit(reach * net.middle(*slope.lack))[0][None]])
        border = border_of(net.points)[net.points]
        p, scaled = (q - q[..., border].mean(axis=-1, keepdims=True) for q in (p, scaled))
        found = {"p": net.grid(p), "p_std": net.grid(_std(scaled, p))}
        return found | self._loads(k, net.points, found["p"], net.grid(scaled))

    def _nothing(self) -> dict[str, ndarray]:
        """`at` of an instant without a field: NaN."""
        shapes: dict[str, tuple[int, ...]] = {"p": (len(self._y), len(self._x))}
        if "outline" in self._walls:
            fingers, points, axes = self._walls["outline"].shape[1:]
            shapes |= {"p_outline": (fingers, points), "line_force": (fingers, axes)}
            shapes |= {"line_moment": (fingers,)}
        return {f"{n}{end}": np.full(s, np.nan) for n, s in shapes.items() for end in ("", "_std")}

    def _loads(self, k: int, known: ndarray, p: ndarray, errors: ndarray) -> dict[str, ndarray]:
        """Pressure and loads on the outline, with standard uncertainties; none without one."""
        if "outline" not in self._walls:
            return {}
        outline = self._walls["outline"][k].values
        wall = wall_gradients(self._walls, k, self._density)
        shore = Shore(self._x, self._y, known, outline, wall)
        found: dict[str, ndarray] = {}
        at, off = shore(p), shore(errors, errors=True)
        values = at, *loads(outline, at, self._about)
        deviations = off, *loads(outline, off, self._about)
        names = ("p_outline", "line_force", "line_moment")
        for name, value, error in zip(names, values, deviations, strict=True):
            found |= {name: value, f"{name}_std": _std(error, value)}
        return found


def _check(series: xr.Dataset, density: float, viscosity: float) -> None:
    if "time" not in series["u"].dims or series.sizes["time"] < 3:
        raise ValueError("pressure follows from accelerations: give a series of 3 fields or more")
    if series["x"].attrs.get("units") == "px" or series["time"].attrs.get("units", "s") != "s":
        raise ValueError(
            "pressure needs metres and seconds: calibrate the vectors first (piv calibrate)"
        )
    for name, value, least in (("density", density, 0.0), ("viscosity", viscosity, -1e-300)):
        if not (np.isfinite(value) and value > least):
            raise ValueError(f"{name} = {value:g}: give a positive number")


def _field(planes: Planes, k: int) -> Field:
    plane, series = planes[k], planes.series
    ok, velocity = usable(plane).values, _velocity(plane)
    ok = ok & np.isfinite(velocity).all(axis=0)
    if {"u_std", "v_std"} <= set(series):
        std = np.stack([plane["u_std"].values, plane["v_std"].values]).astype(float)
    else:
        std = np.broadcast_to(scatter(series, k)[:, None, None], velocity.shape)
    ok = ok & np.isfinite(std).all(axis=0)
    return Field(np.where(ok, velocity, 0.0), np.where(ok, np.maximum(std, LEAST), 0.0), ok)


def _velocity(plane: xr.Dataset) -> ndarray:
    return np.stack([plane["u"].values, plane["v"].values]).astype(float)


def scatter(series: xr.Dataset, k: int) -> ndarray:
    """Standard uncertainty (component,) of vectors without any, m/s.

    From the median of second differences in time about instant `k`: in most of a view the flow is
    smooth.
    """
    for middle in sorted(range(1, series.sizes["time"] - 1), key=lambda m: abs(m - k)):
        three = series.isel(time=slice(middle - 1, middle + 2))
        if not absent(three).any():
            break
    ok = usable(three).values.all(axis=0)
    velocity = np.where(ok, _velocity(three), np.nan)
    second = velocity[:, 0] - 2 * velocity[:, 1] + velocity[:, 2]
    return 1.4826 * np.nanmedian(np.abs(second), axis=(1, 2)) / np.sqrt(6)


def _errors(seed: int, shape: tuple[int, ...], length: float) -> ndarray:
    """Random fields of unit variance, correlated over d grid steps by exp(-2 (d/length)²)."""
    white = np.random.default_rng(seed).standard_normal(shape, dtype=np.float32)
    sigma = length / np.sqrt(8)
    smooth = gaussian_filter(white, (0,) * (len(shape) - 2) + (sigma, sigma), mode="wrap")
    return smooth / np.sqrt(np.mean(smooth**2, axis=(-2, -1), keepdims=True))


def _near(values: ndarray, good: ndarray) -> ndarray:
    """Mean over about a grid step; 0 where not `good`."""
    total = gaussian_filter(np.where(good, values, 0.0), 1.0)
    return np.where(good, total / np.maximum(gaussian_filter(good.astype(float), 1.0), 1e-9), 0.0)


def _weighted(net: Links, difference: ndarray, parts: list[ndarray]) -> Integral:
    """The fit whose variances are those that its residuals show."""
    _, off = Integral(net, parts[0])(difference)
    shares = np.array([1.0, 1e-3 * parts[0].mean() / max(parts[1].mean(), 1e-300)])
    for _ in range(_ROUNDS):
        total = shares[0] * parts[0] + shares[1] * parts[1]
        shares = _two_variances(off**2, parts, [part / total**2 for part in parts])
        shares = np.maximum(shares, [1e-6, 0.0])
    return Integral(net, shares[0] * parts[0] + shares[1] * parts[1])


def border_of(points: ndarray) -> ndarray:
    """The outermost rows and columns (y, x) that hold any of `points`."""
    rows, columns = (np.flatnonzero(points.any(axis=axis)) for axis in (1, 0))
    border = np.zeros(points.shape, bool)
    border[rows[[0, -1]]] = border[:, columns[[0, -1]]] = True
    return border


def _two_variances(squares: ndarray, parts: list[ndarray], instruments: list[ndarray]) -> ndarray:
    """Shares (2,), at least 0, of two variances `parts` (link,) in the mean of `squares` (link,).

    Moments with `instruments`, which do not share the scatter of sampled `parts`.
    """
    matrix = np.array([[np.sum(z * part) for part in parts] for z in instruments])
    seen = np.array([np.sum(z * squares) for z in instruments])
    both = np.array([-1.0, -1.0])
    if abs(np.linalg.det(matrix)) > 1e-12 * abs(matrix[0, 0] * matrix[1, 1]):
        both = np.linalg.solve(matrix, seen)
    if both[1] < 0:
        both = np.array([seen[0] / matrix[0, 0], 0.0])
    elif both[0] < 0:
        both = np.array([0.0, seen[1] / matrix[1, 1]])
    return both


def _std(deviations: ndarray, values: ndarray) -> ndarray:
    """Standard deviation of errors that add up, (error, …), and of the systematic share."""
    return np.sqrt(np.sum(deviations**2, axis=0) + np.square(_SHARE * values))
