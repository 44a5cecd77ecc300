"""Vortices of a plane field: detection by Gamma2 and swirling strength, then a joint Lamb-Oseen fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import xarray as xr

from piv.circulation import area_circulation, clear_radius, contour_circulation, distance_to_invalid
from piv.criteria import gradients, vorticity
from piv.vortex_fit import PEAK_RADIUS, PEAK_SWIRL, Fit, Vectors, fit_vortices, lamb_oseen
from piv.vortex_regions import find_candidates, seen_share


@dataclass(frozen=True)
class Vortex:
    """One vortex, in the plane's units; counter-clockwise positive; `*_std` are standard errors.

    Swirl: circulation/(2 pi r) (1 - exp(-r^2/core_radius^2)); `peak_swirl_velocity` is its signless maximum, at
    `peak_swirl_radius` = 1.1209 core_radius. `circulation_contour` and `circulation_area` are integrals over the circle
    of `contour_radius` (NaN where a body leaves no room for one of half a core radius). `drift_u`, `drift_v`: background
    velocity at the centre; `shear`: norm of the background's gradient; `explained`: part of the vectors' variance that
    the fit explains; `n_vectors`: vectors in the fit.
    """

    x: float
    y: float
    circulation: float
    core_radius: float
    peak_swirl_velocity: float
    x_std: float
    y_std: float
    circulation_std: float
    core_radius_std: float
    peak_swirl_velocity_std: float
    circulation_area: float
    circulation_contour: float
    contour_radius: float
    drift_u: float
    drift_v: float
    shear: float
    explained: float
    n_vectors: int

    @property
    def peak_swirl_radius(self) -> float:
        """Radius of the largest swirl velocity."""
        return PEAK_RADIUS * self.core_radius


@dataclass(frozen=True)
class VortexSettings:
    """How vortices are found; lengths and circulations in the plane's units.

    stencil_radius: radius of the Gamma2 disc; None = two grid steps. Larger finds larger vortices only.
    gamma2: least |Gamma2| of a region (2/pi: rotation exceeds strain).
    min_points: least grid points of a region. max_elongation: longest region, length over width.
    min_circulation: least |circulation|; None = `min_part` of the strongest in the plane.
    significance: least |circulation| over its standard error.
    fit_radius: radius of the fitted disc in core radii; where vectors know their uncertainty it is doubled in steps as long
    as the residuals are no larger than that (the background's rotation is hardly told from the vortex' in a small disc).
    neighbour_part: neighbours weaker than this part of a vortex belong to its background.
    strain_prior, rotation_prior: see `vortex_fit.fit_vortices`.
    region_prior: relative standard deviation of a core radius as told by its region, where half of the disc is hidden; it
    weighs as the hidden part over the seen one, nothing where all is seen.
    correlation_length: distance over which the vectors' errors are correlated (the interrogation window's
    width for PIV); None = estimated from the residuals.
    scheme: of the gradients, `least-squares` or `fourth-order`.
    weights: of the vectors in the fit, by their `uncertainty` (u_std, v_std, where given) or `equal`; equal where
    two planes are compared of which only one has uncertainties.
    """

    stencil_radius: float | None = None
    gamma2: float = 2 / np.pi
    min_points: int = 5
    max_elongation: float = 4.0
    min_circulation: float | None = None
    min_part: float = 0.1
    significance: float = 2.0
    fit_radius: float = 2.0
    min_explained: float = 0.3
    neighbour_part: float = 0.3
    strain_prior: float = 0.3
    rotation_prior: float = 0.03
    region_prior: float = 0.2
    correlation_length: float | None = None
    scheme: str = "least-squares"
    weights: str = "uncertainty"

    def __post_init__(self) -> None:
        if self.weights not in ("uncertainty", "equal"):
            raise ValueError(f"weights = {self.weights!r}: give 'uncertainty' or 'equal'")
        for name in ("strain_prior", "rotation_prior", "region_prior"):
            if not getattr(self, name) > 0:
                raise ValueError(
                    f"{name} = {getattr(self, name):g}: give a positive number, 1e9 to switch it off"
                )


class _Plane(NamedTuple):
    x: np.ndarray
    y: np.ndarray
    u: np.ndarray
    v: np.ndarray
    valid: np.ndarray
    weight_u: np.ndarray
    weight_v: np.ndarray
    xx: np.ndarray
    yy: np.ndarray
    noise_known: bool  # weights are inverse variances


class _Fitted(NamedTuple):
    """Fit of a vortex, its vectors' number and area per independent one, how well they fit, and its region: x, y, circulation, core radius.

    `misfit`: mean square of the residuals over the vectors' variance; `seen`: share of the disc that holds vectors.
    """

    fit: Fit
    n_vectors: int
    area: float
    misfit: float
    seen: float
    region: np.ndarray


WIDER = (1.5, 2.0)  # times fit_radius
MODEL_HOLDS = (
    2.0  # mean square of the residuals over the vectors' variance; 1 of an exact model and uncertainty
)
WATER = 0.95  # share of a wider disc that must hold vectors: beside a body the vortex is not Lamb-Oseen's
POINTS_PER_CORE = 8
SWEEPS = 3  # passes of the fit over all vortices: neighbours and fit discs settle to 1e-3 within three


def find_vortices(
    plane: xr.Dataset, settings: VortexSettings | None = None, **options: float | str
) -> list[Vortex]:
    """Vortices of one plane (dimensions y, x; variables u, v, valid, optional u_std, v_std), strongest first.

    Works in whatever units the plane has. `options` are fields of `VortexSettings`. Candidates are regions of Gamma2 and
    swirling strength; each is then fitted with a Lamb-Oseen vortex on a background of drift and linear gradient, its
    neighbours taken along or taken off. Raises ValueError where the plane still has a time axis or an option is unknown.
    """
    s = _settings(settings, options)
    p = _arrays(plane, s.weights)
    dx, dy = float(p.x[1] - p.x[0]), float(p.y[1] - p.y[0])
    g = gradients(p.u, p.v, p.valid, dx, dy, s.scheme)
    candidates = find_candidates(
        p.x,
        p.y,
        p.u,
        p.v,
        p.valid,
        g,
        stencil_radius=s.stencil_radius or 2 * max(dx, dy),
        threshold=s.gamma2,
        min_points=s.min_points,
        max_elongation=s.max_elongation,
    )
    if not candidates:
        return []
    least = s.min_circulation
    rough = 0.3 * (s.min_part * abs(candidates[0].circulation) if least is None else least)
    regions = np.array([c[:4] for c in candidates if abs(c.circulation) >= rough]).reshape(-1, 4)
    # which vortices there are the vectors alone decide: with its region's help every layer on a wall would pass for one
    fits = _settle(p, np.hstack([regions, regions]), replace(s, region_prior=np.inf))
    if np.isfinite(s.region_prior) and any(f.seen < 1 for f in fits):
        fits = _settle(p, np.array([[*f.fit.vortices[0], *f.region] for f in fits]), s)
    omega = vorticity(g)
    distance = distance_to_invalid(p.valid, dx, dy)
    return sorted(
        (_record(p, f.fit, omega, distance, f.n_vectors) for f in fits), key=lambda w: -abs(w.circulation)
    )


def _settle(p: _Plane, start: np.ndarray, s: VortexSettings) -> list[_Fitted]:
    """Fits from `start` (n, 8: x, y, circulation, core radius, and those of the region), anew until all are vortices."""
    while len(start):  # a weak vortex may not shape the fit of a strong one
        fits = _fit_all(p, start, s)
        before, start = len(start), _significant(fits, s)
        if len(start) == before:
            return fits
    return []


def _significant(fits: list[_Fitted], s: VortexSettings) -> np.ndarray:
    """Parameters of the fits that are strong enough to be reported, and of their regions: (n, 8)."""
    strongest = max((abs(f.fit.vortices[0, 2]) for f in fits), default=0.0)
    least = s.min_part * strongest if s.min_circulation is None else s.min_circulation
    keep = [
        [*f.vortices[0], *region]
        for f, *_, region in fits
        if abs(f.vortices[0, 2]) >= max(least, s.significance * np.sqrt(max(f.covariance[2, 2], 0.0)))
        and f.explained >= s.min_explained
    ]
    return np.array(keep).reshape(-1, 8)


def _settings(settings: VortexSettings | None, options: dict[str, float | str]) -> VortexSettings:
    base = settings or VortexSettings()
    unknown = sorted(set(options) - set(vars(base)))
    if unknown:
        raise ValueError(f"unknown vortex option {unknown[0]!r}; the options are {', '.join(vars(base))}")
    return VortexSettings(**(vars(base) | options))


def _arrays(plane: xr.Dataset, weighting: str) -> _Plane:
    for name in ("u", "v"):
        if name not in plane or set(plane[name].dims) != {"y", "x"}:
            found = plane[name].dims if name in plane else "none"
            raise ValueError(
                f"vortices are found in one plane with {name!r} over (y, x), got dimensions {found}"
            )
    u, v = (plane[n].transpose("y", "x").values.astype(float) for n in ("u", "v"))
    x, y = plane["x"].values.astype(float), plane["y"].values.astype(float)
    valid = np.isfinite(u) & np.isfinite(v)
    if "valid" in plane:
        valid &= plane["valid"].transpose("y", "x").values != 0
    weights = []
    for name in ("u_std", "v_std"):
        if name in plane and weighting == "uncertainty":
            std = plane[name].transpose("y", "x").values.astype(float)
            good = valid & np.isfinite(std) & (std > 0)
            # a few vectors with an implausibly small error must not rule the fit
            floor = 0.3 * np.median(std[good]) if good.any() else 1.0
            weights.append(np.where(good, 1 / np.maximum(np.where(good, std, 1.0), floor) ** 2, 0.0))
        else:
            weights.append(valid.astype(float))
    xx, yy = np.meshgrid(x, y)
    u, v = (np.where(valid, q, np.nan) for q in (u, v))
    noise_known = weighting == "uncertainty" and "u_std" in plane and "v_std" in plane
    return _Plane(x, y, u, v, valid, weights[0], weights[1], xx, yy, noise_known)


def _fit_all(p: _Plane, start: np.ndarray, s: VortexSettings) -> list[_Fitted]:
    """Fit every candidate in turn with its neighbours, several sweeps; drops those that vanish or coincide."""
    now = start[:, :4].copy()
    area = np.full(len(now), 10.0 * (p.x[1] - p.x[0]) * (p.y[1] - p.y[0]))  # per independent vector
    for sweep in range(SWEEPS):
        fits: list[_Fitted | None] = []
        for k in range(len(now)):
            widen = p.noise_known and sweep == SWEEPS - 1  # neighbours are as good as they get
            fits.append(_fit_one(p, now, k, start[k, 4:], float(area[k]), s, WIDER if widen else ()))
        keep = [k for k, f in enumerate(fits) if f is not None and _plausible(p, f.fit, start[k])]
        start = start[keep]
        fits = [fits[k] for k in keep]
        now = np.array([f.fit.vortices[0] for f in fits if f is not None]).reshape(-1, 4)
        order = _distinct(now, [f.fit.explained for f in fits if f is not None])
        now, start, fits = now[order], start[order], [fits[k] for k in order]
        area = np.array([f.area for f in fits if f is not None])
        if not len(now):
            break
    return [f for f in fits if f is not None]


def _fit_one(
    p: _Plane,
    now: np.ndarray,
    k: int,
    region: np.ndarray,
    area: float,
    s: VortexSettings,
    wider: tuple[float, ...],
) -> _Fitted | None:
    """Fit of vortex k over its own disc, or the widest of the `wider` ones that the model holds in."""
    best = _fit_disc(p, now, k, region, area, s, s.fit_radius)
    for factor in wider if best is not None else ():
        found = _fit_disc(p, now, k, region, area, s, factor * s.fit_radius)
        if found is None or found.misfit > MODEL_HOLDS or found.seen < WATER:
            break
        best = found
    return best


def _fit_disc(
    p: _Plane, now: np.ndarray, k: int, region: np.ndarray, area: float, s: VortexSettings, radius: float
) -> _Fitted | None:
    """Fit of vortex k over a disc of `radius` core radii: neighbours in it are fitted along, others taken off as they are."""
    x0, y0, _, a = now[k]
    reach = max(radius * a, 3.0 * max(p.x[1] - p.x[0], p.y[1] - p.y[0]))
    i0, i1 = np.searchsorted(p.x, [x0 - reach, x0 + reach])
    j0, j1 = np.searchsorted(p.y, [y0 - reach, y0 + reach])
    # a grid much finer than the core is thinned: its vectors add no information, only time
    skip = [max(1, int(a / (POINTS_PER_CORE * (c[1] - c[0])))) for c in (p.y, p.x)]
    box = np.s_[j0 : j1 : skip[0], i0 : i1 : skip[1]]
    distance = np.hypot(p.xx[box] - x0, p.yy[box] - y0)
    use = p.valid[box] & (distance <= reach)
    if np.count_nonzero(use) < 12:
        return None
    # weights fall smoothly to zero at the disc's edge, so that no single vector decides where the disc ends
    taper = np.clip(2 * (1 - distance[use] / reach), 0, 1)
    near = np.hypot(now[:, 0] - x0, now[:, 1] - y0)
    strong = np.abs(now[:, 2]) >= s.neighbour_part * abs(now[k, 2])
    strong[k] = False
    along = [m for m in np.argsort(near) if strong[m] and near[m] < reach][:4]
    x, y, u, v = (q[box][use] for q in (p.xx, p.yy, p.u, p.v))
    for m in range(len(now)):
        if strong[m] and m not in along:
            du, dv = lamb_oseen(x, y, *now[m])
            u, v = u - du, v - dv
    vectors = Vectors(x, y, u, v, p.weight_u[box][use] * taper, p.weight_v[box][use] * taper)
    seen = seen_share(p.x, p.y, p.valid, x0, y0, reach)
    # a disc half hidden hardly tells core radius and circulation apart: the less it shows, the more the region is asked
    core_std = s.region_prior * np.sqrt(seen / (1 - seen)) if seen < 1 else np.inf
    step = [skip[0] * (p.y[1] - p.y[0]), skip[1] * (p.x[1] - p.x[0])]
    fit = fit_vortices(
        vectors,
        now[[k, *along]],
        strain_prior=s.strain_prior,
        rotation_prior=s.rotation_prior,
        core=(float(region[3]), core_std),
        correlated=max(1.0, area / (step[0] * step[1])),
    )
    factor = _correlation_factor(step, fit, use, s.correlation_length)
    square = p.weight_u[box][use] * fit.residual_u**2 + p.weight_v[box][use] * fit.residual_v**2
    return _Fitted(
        fit._replace(covariance=fit.covariance * factor),
        int(np.count_nonzero(use)),
        factor * step[0] * step[1],
        float(square.mean()) / 2,
        seen,
        region,
    )


def _correlation_factor(step: list[float], fit: Fit, use: np.ndarray, length: float | None) -> float:
    """By how much correlated errors raise the variance of fitted values: number of vectors per independent one.

    With a correlation length L (box window, triangular autocorrelation) (L/dx) (L/dy), at least 1; otherwise the sum of
    the residuals' autocorrelation over all lags up to its first fall below 0.05, per direction.
    """
    if length is not None:
        return max(1.0, length / step[0]) * max(1.0, length / step[1])
    r = np.full((2, *use.shape), np.nan)
    r[0][use], r[1][use] = fit.residual_u, fit.residual_v
    factor = 1.0
    for axis in (1, 2):
        total = 1.0
        for lag in range(1, r.shape[axis] // 2):
            a = np.take(r, range(r.shape[axis] - lag), axis)
            b = np.take(r, range(lag, r.shape[axis]), axis)
            both = np.isfinite(a) & np.isfinite(b)
            power = float((a[both] ** 2 + b[both] ** 2).sum()) / 2
            rho = float((a[both] * b[both]).sum()) / power if power > 0 else 0.0
            if rho < 0.05:
                break
            total += 2 * rho
        factor *= total
    return factor


def _plausible(p: _Plane, fit: Fit, start: np.ndarray) -> bool:
    """Whether a fit is still the vortex it started from, inside the plane and resolved by the grid."""
    x, y, circulation, a = fit.vortices[0]
    step = max(p.x[1] - p.x[0], p.y[1] - p.y[0])
    span = min(p.x[-1] - p.x[0], p.y[-1] - p.y[0])
    inside = p.x[0] <= x <= p.x[-1] and p.y[0] <= y <= p.y[-1]
    moved = np.hypot(x - start[0], y - start[1])
    return bool(
        inside
        and circulation * start[2] > 0
        and 0.4 * step <= a <= min(0.5 * span, 3 * max(start[3], step))
        and moved <= 2 * max(start[3], step)
        and np.all(np.isfinite(fit.covariance))
    )


def _distinct(now: np.ndarray, explained: list[float]) -> list[int]:
    """Indices without those that ended on top of a better fitted vortex of the same sense (half a core away)."""
    kept: list[int] = []
    for k in np.argsort(explained)[::-1]:
        near = [
            m
            for m in kept
            if now[m, 2] * now[k, 2] > 0
            and np.hypot(*(now[m, :2] - now[k, :2])) < 0.5 * max(now[m, 3], now[k, 3])
        ]
        if not near:
            kept.append(int(k))
    return sorted(kept)


def _record(p: _Plane, fit: Fit, omega: np.ndarray, distance: np.ndarray, n: int) -> Vortex:
    x, y, circulation, a = (float(q) for q in fit.vortices[0])
    x_std, y_std, circulation_std, a_std = (
        float(q) for q in np.sqrt(np.maximum(np.diag(fit.covariance)[:4], 0))
    )
    peak = PEAK_SWIRL * abs(circulation) / (2 * np.pi * a)
    slope = np.array([peak / circulation, -peak / a])
    peak_std = float(np.sqrt(max(slope @ fit.covariance[2:4, 2:4] @ slope, 0.0)))
    radius = clear_radius(distance, p.x, p.y, x, y, 2 * a)
    room = radius >= 0.5 * a
    gradient = fit.background[[1, 2, 4, 5]]
    return Vortex(
        x,
        y,
        circulation,
        a,
        float(peak),
        x_std,
        y_std,
        circulation_std,
        a_std,
        peak_std,
        area_circulation(p.x, p.y, omega, x, y, radius) if room else np.nan,
        contour_circulation(p.x, p.y, p.u, p.v, x, y, radius) if room else np.nan,
        radius if room else np.nan,
        float(fit.background[0]),
        float(fit.background[3]),
        float(np.hypot.reduce(gradient)),
        fit.explained,
        n,
    )
