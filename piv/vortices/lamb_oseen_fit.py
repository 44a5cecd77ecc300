"""Lamb-Oseen vortices on a linear background, fitted by weighted least squares.

v_theta(r) = circulation/(2 pi r) (1 - exp(-r^2/core_radius^2)). The swirl peaks at r = 1.1209
core_radius with 0.6382 circulation/(2 pi core_radius).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy import ndarray

from piv.compiled import compiled

PEAK_RADIUS = 1.1209064227785338  # of the swirl, in core radii: root of exp(s^2) = 1 + 2 s^2
PEAK_SWIRL = 0.6381726863389515  # in circulation/(2 pi core_radius)
MAX_ITERATIONS = 60
# relative; a neighbour is mostly known from its own fit, this one sees only its near side
NEIGHBOUR_PRIOR = 0.3


class VelocitySamples(NamedTuple):
    """Scattered vectors: positions, components, weights, each (n,); any consistent units."""

    x: ndarray
    y: ndarray
    u: ndarray
    v: ndarray
    weight_u: ndarray
    weight_v: ndarray


class Fit(NamedTuple):
    """Vortices (n, 4: x, y, circulation, core_radius), background, covariance and residuals.

    background (6): u, du/dx, du/dy, v, dv/dx, dv/dy at the first vortex' start. covariance:
    without error correlation. explained: part of the variance.
    """

    vortices: ndarray
    background: ndarray
    covariance: ndarray
    residual_u: ndarray
    residual_v: ndarray
    explained: float


def lamb_oseen(
    x: ndarray, y: ndarray, x0: float, y0: float, circulation: float, core_radius: float
) -> tuple[ndarray, ndarray]:
    """Velocity (u, v) of a Lamb-Oseen vortex at points x, y."""
    rx, ry = np.broadcast_arrays(np.asarray(x, float) - x0, np.asarray(y, float) - y0)
    vortex = np.array([[0.0, 0.0, circulation, core_radius]])
    u, v = velocities(rx.ravel(), ry.ravel(), vortex)
    return u.reshape(rx.shape), v.reshape(rx.shape)


@compiled
def velocities(x, y, vortices):
    """Velocity (u, v) at points (n,) of all `vortices` (m, 4: x, y, circulation, core radius)."""
    u, v = np.zeros(x.size), np.zeros(x.size)
    for k in range(len(vortices)):
        x0, y0, circulation, a = vortices[k]
        for i in range(x.size):
            rx, ry = x[i] - x0, y[i] - y0
            g = circulation / (2 * math.pi) * _shape(rx * rx + ry * ry, a)[0]
            u[i] -= g * ry
            v[i] += g * rx
    return u, v


@njit(cache=True, inline="always")
def _shape(r2, core_radius):
    """(1 - exp(-s))/r^2, s = r^2/core_radius^2; derivatives by r^2 and log(core_radius)."""
    a2 = core_radius**2
    s = r2 / a2
    e = math.exp(-s)
    if s < 1e-4:
        return (1 - s / 2) / a2, (-0.5 + s / 3) / a2**2, -2 * e / a2
    return -math.expm1(-s) / s / a2, (e * (1 + s) - 1) / s**2 / a2**2, -2 * e / a2


@compiled
def _normal_equations(p, n, d, ox, oy):
    """Weighted squares of the residuals, J'WJ and J'W(data - model).

    Parameters: x, y, circulation, log core_radius of each vortex, then the background.
    """
    size = p.size
    normal, rhs = np.zeros((size, size)), np.zeros(size)
    ju, jv = np.zeros(size), np.zeros(size)
    core = np.exp(p[3 : 4 * n : 4])
    b = 4 * n
    cost = 0.0
    for i in range(d.x.size):
        bx, by = d.x[i] - ox, d.y[i] - oy
        ju[b], ju[b + 1], ju[b + 2] = 1.0, bx, by
        jv[b + 3], jv[b + 4], jv[b + 5] = 1.0, bx, by
        ru = d.u[i] - p[b] - p[b + 1] * bx - p[b + 2] * by
        rv = d.v[i] - p[b + 3] - p[b + 4] * bx - p[b + 5] * by
        for k in range(n):
            rx, ry = d.x[i] - p[4 * k], d.y[i] - p[4 * k + 1]
            g, dg, da = _shape(rx * rx + ry * ry, core[k])
            c = p[4 * k + 2] / (2 * math.pi)
            ju[4 * k] = c * 2 * dg * rx * ry
            jv[4 * k] = -c * (g + 2 * dg * rx * rx)
            ju[4 * k + 1] = c * (g + 2 * dg * ry * ry)
            jv[4 * k + 1] = -c * 2 * dg * rx * ry
            ju[4 * k + 2] = -g * ry / (2 * math.pi)
            jv[4 * k + 2] = g * rx / (2 * math.pi)
            ju[4 * k + 3] = -c * da * ry
            jv[4 * k + 3] = c * da * rx
            ru += c * g * ry
            rv -= c * g * rx
        wu, wv = d.weight_u[i], d.weight_v[i]
        cost += wu * ru * ru + wv * rv * rv
        for q in range(size):
            au, av = wu * ju[q], wv * jv[q]
            rhs[q] += au * ru + av * rv
            for r in range(q + 1):
                normal[q, r] += au * ju[r] + av * jv[r]
    for q in range(size):
        for r in range(q):
            normal[r, q] = normal[q, r]
    return cost, normal, rhs


@compiled
def _solve(a, b):
    """Solution (n, m) of a x = b; `a` positive definite but for rounding, in any scales."""
    size = len(b)
    scale = np.empty(size)
    for q in range(size):
        scale[q] = 1 / math.sqrt(max(a[q, q], 1e-300))
    low, x = np.zeros((size, size)), np.empty(b.shape)
    for q in range(size):
        for r in range(q + 1):
            total = a[q, r] * scale[q] * scale[r]
            for k in range(r):
                total -= low[q, k] * low[r, k]
            # a pivot of rounding alone: the others already tell all of this unknown, it stays where
            # it is
            if q == r:
                low[q, q] = math.sqrt(total) if total > 1e-14 else 1e30
            else:
                low[q, r] = total / low[r, r]
    for m in range(b.shape[1]):
        for q in range(size):
            total = scale[q] * b[q, m]
            for k in range(q):
                total -= low[q, k] * x[k, m]
            x[q, m] = total / low[q, q]
        for q in range(size - 1, -1, -1):
            for k in range(q + 1, size):
                x[q, m] -= low[k, q] * x[k, m]
            x[q, m] /= low[q, q]
        for q in range(size):
            x[q, m] *= scale[q]
    return x


@compiled
def _levenberg_marquardt(p, n, d, unit, mean, correlated, dof):
    """Parameters that fit best from `p`, their squares of residuals, J'WJ and prior."""
    ox, oy = p[0], p[1]
    first_core = p[3 : 4 * n : 4].copy()
    squares, jtj, jtr = _normal_equations(p, n, d, ox, oy)
    prior = unit * (correlated * squares / dof)
    damping = 1e-5
    for _ in range(MAX_ITERATIONS):
        prior = unit * (correlated * squares / dof)
        cost = squares + (p - mean) @ (prior @ (p - mean))
        normal = jtj + prior
        rhs = jtr - prior @ (p - mean)
        damped = normal.copy()
        floor = 0.0
        for q in range(p.size):
            floor = max(floor, 1e-12 * normal[q, q])
        for q in range(p.size):
            damped[q, q] += damping * (normal[q, q] + floor)
        step = _solve(damped, rhs.reshape(-1, 1))[:, 0].copy()
        for k in range(
            n
        ):  # no leap over several cores, no core growing or shrinking by more than a factor
            limit = math.exp(p[4 * k + 3])
            for q in (4 * k, 4 * k + 1):
                step[q] = min(max(step[q], -limit), limit)
            grown = p[4 * k + 3] - first_core[k]
            step[4 * k + 3] = min(max(step[4 * k + 3], max(-0.5, -1 - grown)), min(0.5, 1 - grown))
        # nothing left to gain
        if 2 * (step @ rhs) - step @ (normal @ step) <= 1e-7 * cost + 1e-300:
            if damping <= 1e-7:
                break
            damping /= 100  # a damped step may gain little in a long valley: look again undamped
            continue
        moved = p + step
        new_squares, new_jtj, new_jtr = _normal_equations(moved, n, d, ox, oy)
        if new_squares + (moved - mean) @ (prior @ (moved - mean)) <= cost:
            p, squares, jtj, jtr = moved, new_squares, new_jtj, new_jtr
            damping = max(damping / 5, 1e-9)
        else:
            damping *= 4
    return p, squares, jtj, prior


def fit_vortices(
    d: VelocitySamples,
    start: ndarray,
    *,
    strain_prior: float = np.inf,
    rotation_prior: float = np.inf,
    correlated: float = 1.0,
) -> Fit:
    """Fit the vortices `start` (n, 4) jointly with drift and a linear gradient.

    Levenberg-Marquardt with the analytic Jacobian. `strain_prior`, `rotation_prior`: standard
    deviations of the background's gradient and of its vorticity expected beforehand, as parts of
    the first vortex' peak vorticity; they only matter where the vectors do not tell background from
    vortex (one half hidden by a body, or not quite Lamb-Oseen). `correlated`: number of vectors
    per independent one, which puts the vectors' information in proportion to the prior's whatever
    the grid. A centre moves at most a core radius per iteration; a core radius stays within a
    factor e of its start. The covariance is scaled with the residuals' weighted variance and does
    not hold `correlated`.
    """
    n = len(start)
    d = VelocitySamples(*(np.ascontiguousarray(q, float) for q in d))
    p = np.concatenate([np.column_stack([start[:, :3], np.log(start[:, 3])]).ravel(), np.zeros(6)])
    # linear start: the background that fits best around the given vortices
    _, normal, rhs = _normal_equations(p, n, d, p[0], p[1])
    p[4 * n :] = _solve(normal[4 * n :, 4 * n :].copy(), rhs[4 * n :, None].copy())[:, 0]
    slopes = 4 * n + np.array([1, 2, 4, 5])
    dof = max(1, np.count_nonzero(d.weight_u) + np.count_nonzero(d.weight_v) - p.size)
    scale = abs(start[0, 2]) / (np.pi * start[0, 3] ** 2)
    unit, mean = _prior(start, p, slopes, strain_prior * scale, rotation_prior * scale)
    ox, oy = p[:2]
    p, squares, jtj, prior = _levenberg_marquardt(p, n, d, unit, mean, float(correlated), dof)
    spread = sum(
        float(w @ (q - w @ q / w.sum()) ** 2) for q, w in ((d.u, d.weight_u), (d.v, d.weight_v))
    )
    covariance = squares / dof * _solve(jtj + prior, np.eye(p.size))
    vortices, background = p[: 4 * n].reshape(n, 4).copy(), p[4 * n :]
    vortices[:, 3] = np.exp(vortices[:, 3])
    to_radius = np.ones(p.size)
    to_radius[3 : 4 * n : 4] = vortices[:, 3]
    covariance *= np.outer(to_radius, to_radius)
    u, v = velocities(d.x, d.y, vortices)
    basis = np.array([np.ones_like(d.x), d.x - ox, d.y - oy])
    explained = 1 - squares / spread if spread > 0 else 1.0
    return Fit(
        vortices,
        background,
        covariance,
        d.u - u - background[:3] @ basis,
        d.v - v - background[3:] @ basis,
        explained,
    )


def _prior(
    start: ndarray,
    p: ndarray,
    slopes: ndarray,
    strain: float,
    rotation: float,
) -> tuple[ndarray, ndarray]:
    """Inverse covariance and mean of the prior of background and neighbours."""
    unit, mean = np.zeros((p.size, p.size)), np.zeros(p.size)
    unit[slopes, slopes] = 1 / strain**2
    unit[np.ix_(slopes[1:3], slopes[1:3])] += np.array([[1, -1], [-1, 1]]) / rotation**2
    for k in range(1, len(start)):
        at = np.arange(4 * k, 4 * k + 4)
        mean[at] = p[at]
        spread = NEIGHBOUR_PRIOR * np.array([start[k, 3], start[k, 3], abs(start[k, 2]), 1.0])
        unit[at, at] = 1 / spread**2
    return unit, mean
