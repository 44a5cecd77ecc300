"""The joint fit of all vortices of a plane, each over its own disc, on a linear background."""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from piv.compiled import compiled
from piv.vortices.lamb_oseen_fit import (
    PEAK_SWIRL,
    Fit,
    VelocitySamples,
    fit_vortices,
    velocities,
)
from piv.vortices.region_errors import OF_PIV
from piv.vortices.region_measures import Plane
from piv.vortices.settings import VortexSettings


class Fitted(NamedTuple):
    """Fit of a vortex, how well it fits, and its region: x, y, circulation, core radius.

    `misfit`: mean square of the residuals over the vectors' variance; `seen`: share of the disc
    that holds vectors.
    """

    fit: Fit
    area: float
    misfit: float
    seen: float
    region: ndarray


WIDER = (1.5, 2.0)  # times fit_radius
# mean square of the residuals over the vectors' variance; 1 of an exact model and uncertainty
MODEL_HOLDS = 2.0
# explained part from which on what is left may be noise; in turbulence it is flow that no vortex
# explains
NOISE_ONLY = 0.95
# share of a disc's part of the plane that holds vectors away from bodies; with less, the vortex is
# hardly Lamb-Oseen's
UNHIDDEN = 0.95
# of the difference from the next smaller disc, which tells how far PIV's vortex is from
# Lamb-Oseen's: a standard error
DISCS_DIFFER = 0.8
# errors of circulation and core by PIV's smoothing over the vectors' uncertainty, and core radii
# over the distance of shared errors between which they rise from nothing
OF_DAMPING, DAMPED = (1.4, 1.0), (0.9, 1.15)
POINTS_PER_CORE = 8
# passes of the fit over all vortices: neighbours and fit discs converge to 1e-3 within three
SWEEPS = 3


def fit_regions(p: Plane, regions: ndarray, s: VortexSettings) -> list[tuple[float, ...] | None]:
    """The fit to each of the `regions` (n, 4: x, y, circulation, core radius), None where bad.

    Of each x, y, circulation, core radius, their standard errors, and the explained part. A bad one
    is left out and the others are fitted anew.
    """
    start = np.hstack([regions, regions])
    fits = _significant(_fit_all(p, start, s, SWEEPS), s)
    at_once = len(fits) == len(start)
    while len(fits) < len(start):
        start = _parameters(fits)
        fits = _significant(_fit_all(p, start, s, 1), s)
    if not at_once:
        fits = _significant(_fit_all(p, _parameters(fits), s, SWEEPS), s)
    of = {tuple(f.region): f.fit for f in fits}
    return [_numbers(p, of[tuple(r)]) if tuple(r) in of else None for r in regions]


def _numbers(p: Plane, fit: Fit) -> tuple[float, ...]:
    std = np.sqrt(np.maximum(np.diag(fit.covariance)[:4], 0.0))
    if p.noise is not None:
        std[2:] = np.hypot(std[2:], _alike(p, p.noise, fit) * fit.vortices[0, 2:])
    return (*fit.vortices[0].tolist(), *std.tolist(), float(fit.explained))


def _alike(p: Plane, noise: tuple[ndarray, ndarray], fit: Fit) -> ndarray:
    """Relative standard errors of circulation and core by what errs alike all round the vortex.

    PIV damps what does not rise above its noise. Of a core wider than its windows that is a part of
    the swirl, up to the vectors' own uncertainty.
    """
    x, y, circulation, a = fit.vortices[0]
    near = p.valid & (np.hypot(p.x - x, p.y[:, None] - y) < 2 * a)
    wide = np.interp(a / p.correlated, DAMPED, (0, 1)) if p.correlated > max(p.step) else 0.0
    level = np.sqrt(np.mean([n[near] ** 2 for n in noise])) if near.any() else 0.0
    swirl = PEAK_SWIRL * abs(circulation) / (2 * np.pi * a)
    return np.hypot([OF_PIV, 0.0], np.array(OF_DAMPING) * wide * level / swirl)


def _parameters(fits: list[Fitted]) -> ndarray:
    """Of the fits and of their regions: (n, 8)."""
    return np.array([[*f.fit.vortices[0], *f.region] for f in fits]).reshape(-1, 8)


def _significant(fits: list[Fitted], s: VortexSettings) -> list[Fitted]:
    """The fits that explain the vectors and tell the circulation."""
    return [
        f
        for f in fits
        if abs(f.fit.vortices[0, 2]) >= s.significance * np.sqrt(max(f.fit.covariance[2, 2], 0.0))
        and f.fit.explained >= s.min_explained
    ]


def _fit_all(p: Plane, start: ndarray, s: VortexSettings, sweeps: int) -> list[Fitted]:
    """Fit every candidate (n, 8, see `_parameters`) with its neighbours, in several sweeps."""
    now = start[:, :4].copy()
    area = np.full(len(now), 10.0 * (p.x[1] - p.x[0]) * (p.y[1] - p.y[0]))  # per independent vector
    fits: list[Fitted] = []
    for sweep in range(sweeps):
        # in the last sweep neighbours are as good as they get
        wider = WIDER if s.weights == "uncertainty" and sweep == sweeps - 1 else ()
        fit_one = partial(_fit_one, p, now, start, area, s, wider)
        attempts = zip(map(fit_one, range(len(now))), start, strict=True)
        kept = [(f, a) for f, a in attempts if f and _plausible(p, f.fit, a)]
        kept = [kept[k] for k in _distinct([f.fit for f, _ in kept])]
        fits = [f for f, _ in kept]
        if not fits:
            break
        start = np.array([a for _, a in kept])
        now = np.array([f.fit.vortices[0] for f in fits])
        area = np.array([f.area for f in fits])
    return fits


def _fit_one(
    p: Plane,
    now: ndarray,
    start: ndarray,
    area: ndarray,
    s: VortexSettings,
    wider: tuple[float, ...],
    k: int,
) -> Fitted | None:
    """Fit of vortex k over its own disc, or the widest `wider` one in which the model holds."""
    best = _fit_disc(p, now, start, area, s, s.fit_radius, k)
    if best is None:
        return None
    known = p.noise is not None and s.weights == "uncertainty"
    if not known and best.fit.explained < NOISE_ONLY:
        return best
    # where the vectors' noise is not known, what the smallest disc leaves is taken for it
    noise = 1.0 if known else best.misfit
    for factor in wider:
        wide_fit = _fit_disc(p, now, start, area, s, factor * s.fit_radius, k)
        if wide_fit is None or wide_fit.misfit > MODEL_HOLDS * noise or wide_fit.seen < UNHIDDEN:
            break
        best = wide_fit._replace(fit=_doubted(wide_fit.fit, best.fit))
    return best


def _doubted(fit: Fit, smaller: Fit) -> Fit:
    """The fit with the standard errors that its difference from the `smaller` disc's adds."""
    p = fit.vortices[0]
    variance = np.diag(fit.covariance)[:4]
    added = (DISCS_DIFFER * (p - smaller.vortices[0])) ** 2
    factor = np.ones(len(fit.covariance))
    factor[:4] = np.sqrt(1 + added / np.maximum(variance, 1e-300))
    return fit._replace(covariance=fit.covariance * np.outer(factor, factor))


def _fit_disc(
    p: Plane, now: ndarray, start: ndarray, area: ndarray, s: VortexSettings, radius: float, k: int
) -> Fitted | None:
    """Fit of vortex k over `radius` core radii: neighbours are fitted too, or subtracted."""
    x0, y0, _, a = now[k]
    reach = max(radius * a, 3.0 * max(p.x[1] - p.x[0], p.y[1] - p.y[0]))
    i0, i1 = np.searchsorted(p.x, [x0 - reach, x0 + reach])
    j0, j1 = np.searchsorted(p.y, [y0 - reach, y0 + reach])
    # a grid much finer than the core is thinned: its vectors add no information, only time
    skip = [max(1, int(a / (POINTS_PER_CORE * (c[1] - c[0])))) for c in (p.y, p.x)]
    box = np.s_[j0 : j1 : skip[0], i0 : i1 : skip[1]]
    xx, yy = np.meshgrid(p.x[box[1]], p.y[box[0]])
    distance = np.hypot(xx - x0, yy - y0)
    use = p.valid[box] & (distance <= reach)
    if np.count_nonzero(use) < 12:
        return None
    # weights fall smoothly to zero at the disc's edge, so that no single vector decides where the
    # disc ends
    taper = np.clip(2 * (1 - distance[use] / reach), 0, 1)
    near = np.hypot(now[:, 0] - x0, now[:, 1] - y0)
    strong = np.abs(now[:, 2]) >= s.neighbour_part * abs(now[k, 2])
    strong[k] = False
    along = [m for m in np.argsort(near) if strong[m] and near[m] < reach][:4]
    x, y, u, v = (q[use] for q in (xx, yy, p.u[box], p.v[box]))
    strong[along] = False  # the others are taken off as they are
    du, dv = velocities(x, y, now[strong])
    vectors = VelocitySamples(
        x, y, u - du, v - dv, p.weight_u[box][use] * taper, p.weight_v[box][use] * taper
    )
    seen = _seen_share(p.x, p.y, p.valid, x0, y0, reach)
    step = [skip[0] * (p.y[1] - p.y[0]), skip[1] * (p.x[1] - p.x[0])]
    fit = fit_vortices(
        vectors,
        now[[k, *along]],
        strain_prior=s.strain_prior,
        rotation_prior=s.rotation_prior,
        correlated=max(1.0, float(area[k]) / (step[0] * step[1])),
    )
    factor = _correlation_factor(step, fit, use, s.correlation_length)
    square = p.weight_u[box][use] * fit.residual_u**2 + p.weight_v[box][use] * fit.residual_v**2
    return Fitted(
        fit._replace(covariance=fit.covariance * factor),
        factor * step[0] * step[1],
        float(square.mean()) / 2,
        seen,
        start[k, 4:8],
    )


def _correlation_factor(step: list[float], fit: Fit, use: ndarray, length: float | None) -> float:
    """Factor of correlated errors on the variance: number of vectors per independent one.

    With a correlation length L (box window, triangular autocorrelation) (L/dx) (L/dy), at least 1;
    otherwise the sum of the residuals' autocorrelation over all lags up to its first fall below
    0.05, per direction.
    """
    if length is not None:
        return max(1.0, length / step[0]) * max(1.0, length / step[1])
    u, v = np.zeros(use.shape), np.zeros(use.shape)
    u[use], v[use] = fit.residual_u, fit.residual_v
    return _correlated_points(u, v, use) * _correlated_points(u.T, v.T, use.T)


@compiled
def _correlated_points(u, v, use):
    """Autocorrelation of u and v (y, x) along y, summed up to its first fall below 0.05."""
    rows, columns = use.shape
    total = 1.0
    for lag in range(1, rows // 2):
        product = power = 0.0
        for j in range(rows - lag):
            for i in range(columns):
                if use[j, i] and use[j + lag, i]:
                    product += u[j, i] * u[j + lag, i] + v[j, i] * v[j + lag, i]
                    power += u[j, i] ** 2 + v[j, i] ** 2 + u[j + lag, i] ** 2 + v[j + lag, i] ** 2
        if not 2 * product >= 0.05 * power or power == 0:
            break
        total += 4 * product / power
    return total


def _plausible(p: Plane, fit: Fit, start: ndarray) -> bool:
    """Whether a fit is still the vortex it started from, inside the plane and resolved."""
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


def _distinct(fits: list[Fit]) -> list[int]:
    """Indices without vortices on top of a better one: half a core, or one of opposite sense."""
    kept: list[int] = []
    for k in np.argsort([f.explained for f in fits])[::-1]:
        x, y, circulation, a = fits[k].vortices[0]
        others = np.array([fits[m].vortices[0] for m in kept]).reshape(-1, 4)
        away = np.hypot(others[:, 0] - x, others[:, 1] - y) / np.maximum(others[:, 3], a)
        if np.all(away >= np.where(others[:, 2] * circulation > 0, 0.5, 1.0)):
            kept.append(int(k))
    return sorted(kept)


@compiled
def _seen_share(x, y, valid, cx, cy, radius):
    """Part of the disc's grid points within the plane that have a vector."""
    dx, dy = x[1] - x[0], y[1] - y[0]
    seen = disc = 0
    for j in range(math.ceil((cy - radius - y[0]) / dy), math.floor((cy + radius - y[0]) / dy) + 1):
        for i in range(
            math.ceil((cx - radius - x[0]) / dx), math.floor((cx + radius - x[0]) / dx) + 1
        ):
            inside = 0 <= i < x.size and 0 <= j < y.size
            if inside and math.hypot(x[0] + i * dx - cx, y[0] + j * dy - cy) <= radius:
                disc += 1
                seen += valid[j, i]
    return seen / max(1, disc)
