"""Lamb-Oseen vortices on a linear background, fitted to scattered vectors by weighted least squares.

v_theta(r) = circulation/(2 pi r) (1 - exp(-r^2/core_radius^2)). The swirl peaks at r = 1.1209 core_radius with
0.6382 circulation/(2 pi core_radius).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

PEAK_RADIUS = 1.1209064227785338  # of the swirl, in core radii: root of exp(s^2) = 1 + 2 s^2
PEAK_SWIRL = 0.6381726863389515  # in circulation/(2 pi core_radius)
MAX_ITERATIONS = 60
# relative; a neighbour is mostly known from its own fit, this one sees only its near side
NEIGHBOUR_PRIOR = 0.3


class VelocitySamples(NamedTuple):
    """Scattered vectors: positions, components and standard deviations, each (n,); any consistent units."""

    x: np.ndarray
    y: np.ndarray
    u: np.ndarray
    v: np.ndarray
    weight_u: np.ndarray
    weight_v: np.ndarray


class Fit(NamedTuple):
    """Result of `fit_vortices`: vortices (n, 4: x, y, circulation, core_radius), background (6: u, du/dx, du/dy, v, dv/dx,
    dv/dy at the first vortex' start), covariance of all (unscaled by error correlation), residuals and explained part."""

    vortices: np.ndarray
    background: np.ndarray
    covariance: np.ndarray
    residual_u: np.ndarray
    residual_v: np.ndarray
    explained: float


def lamb_oseen(
    x: np.ndarray, y: np.ndarray, x0: float, y0: float, circulation: float, core_radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """Velocity (u, v) of a Lamb-Oseen vortex at points x, y."""
    rx, ry = np.asarray(x) - x0, np.asarray(y) - y0
    g = circulation / (2 * np.pi) * _shape(rx * rx + ry * ry, core_radius)[0]
    return -g * ry, g * rx


def _shape(r2: np.ndarray, core_radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(1 - exp(-s))/r^2 with s = r^2/core_radius^2, its derivative by r^2, and by log(core_radius)."""
    a2 = core_radius**2
    s = r2 / a2
    small = s < 1e-4
    safe = np.where(small, 1.0, s)
    e = np.exp(-s)
    g = np.where(small, 1 - s / 2, -np.expm1(-safe) / safe) / a2
    dg = np.where(small, -0.5 + s / 3, (e * (1 + safe) - 1) / safe**2) / a2**2
    return g, dg, -2 * e / a2


def _model(p: np.ndarray, n: int, d: VelocitySamples, ox: float, oy: float) -> tuple[np.ndarray, np.ndarray]:
    """Model (2 m,) and Jacobian (2 m, 4 n + 6) for parameters x, y, circulation, log core_radius ... background."""
    m = d.x.size
    jac = np.zeros((2 * m, p.size))
    value = np.zeros(2 * m)
    for k in range(n):
        x0, y0, gamma, log_a = p[4 * k : 4 * k + 4]
        rx, ry = d.x - x0, d.y - y0
        g, dg, da = _shape(rx * rx + ry * ry, float(np.exp(log_a)))
        c = gamma / (2 * np.pi)
        jac[:m, 4 * k] = c * 2 * dg * rx * ry
        jac[m:, 4 * k] = -c * (g + 2 * dg * rx * rx)
        jac[:m, 4 * k + 1] = c * (g + 2 * dg * ry * ry)
        jac[m:, 4 * k + 1] = -c * 2 * dg * rx * ry
        jac[:m, 4 * k + 2] = -g * ry / (2 * np.pi)
        jac[m:, 4 * k + 2] = g * rx / (2 * np.pi)
        jac[:m, 4 * k + 3] = -c * da * ry
        jac[m:, 4 * k + 3] = c * da * rx
        value[:m] -= c * g * ry
        value[m:] += c * g * rx
    for k, basis in enumerate((np.ones(m), d.x - ox, d.y - oy)):
        jac[:m, 4 * n + k] = basis
        jac[m:, 4 * n + 3 + k] = basis
    value += jac[:, 4 * n :] @ p[4 * n :]
    return value, jac


def fit_vortices(
    d: VelocitySamples,
    start: np.ndarray,
    *,
    strain_prior: float = np.inf,
    rotation_prior: float = np.inf,
    core: tuple[float, float] = (1.0, np.inf),
    correlated: float = 1.0,
) -> Fit:
    """Fit the vortices `start` (n, 4: x, y, circulation, core_radius) jointly with drift and a linear gradient.

    Levenberg-Marquardt with the analytic Jacobian. `strain_prior`, `rotation_prior`: standard deviations of the
    background's gradient and of its vorticity expected beforehand, as parts of the first vortex' peak vorticity; they
    only matter where the vectors do not tell background from vortex (one half hidden by a body, or not quite
    Lamb-Oseen). `core`: the first vortex' core radius expected beforehand and its relative standard deviation.
    `correlated`: number of vectors per independent one, which puts the vectors' information in
    proportion to the prior's whatever the grid. A centre moves at most a core radius per iteration; a core radius stays
    within a factor e of its start. The covariance is scaled with the residuals' weighted variance and does not hold
    `correlated`.
    """
    n = len(start)
    ox, oy = start[0, 0], start[0, 1]
    p = np.concatenate([np.column_stack([start[:, :3], np.log(start[:, 3])]).ravel(), np.zeros(6)])
    data = np.concatenate([d.u, d.v])
    root = np.sqrt(np.concatenate([d.weight_u, d.weight_v]))
    value, jac = _model(p, n, d, ox, oy)
    # linear start: the background that fits best around the given vortices
    p[4 * n :] = np.linalg.lstsq(root[:, None] * jac[:, 4 * n :], root * (data - value), rcond=None)[0]
    slopes = 4 * n + np.array([1, 2, 4, 5])
    dof = max(1, int(np.count_nonzero(root)) - p.size)
    scale = abs(start[0, 2]) / (np.pi * start[0, 3] ** 2)
    unit, mean = _prior(start, p, slopes, strain_prior * scale, rotation_prior * scale, core)
    prior = np.zeros_like(unit)

    def cost_of(q: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        model, j = _model(q, n, d, ox, oy)
        r = root * (data - model)
        return float(r @ r + (q - mean) @ prior @ (q - mean)), r, root[:, None] * j

    _, r, j = cost_of(p)
    damping = 1e-5
    for _iteration in range(MAX_ITERATIONS):
        prior = unit * (correlated * (r @ r) / dof)
        cost = float(r @ r + (p - mean) @ prior @ (p - mean))
        normal = j.T @ j + prior
        rhs = j.T @ r - prior @ (p - mean)
        diagonal = np.diag(normal)
        step = _solve(normal + damping * np.diag(diagonal + 1e-12 * diagonal.max()), rhs)
        for k in range(n):  # no leap over several cores, no core growing or shrinking by more than a factor
            limit = np.exp(p[4 * k + 3])
            step[4 * k : 4 * k + 2] = np.clip(step[4 * k : 4 * k + 2], -limit, limit)
            grown = p[4 * k + 3] - np.log(start[k, 3])
            step[4 * k + 3] = np.clip(step[4 * k + 3], max(-0.5, -1 - grown), min(0.5, 1 - grown))
        if 2 * step @ rhs - step @ normal @ step <= 1e-7 * cost + 1e-300:  # nothing left to gain
            if damping <= 1e-7:
                break
            damping /= 100  # a damped step may gain little in a long valley: look again undamped
            continue
        new_cost, new_r, new_j = cost_of(p + step)
        if new_cost <= cost:
            p, r, j = p + step, new_r, new_j
            damping = max(damping / 5, 1e-9)
        else:
            damping *= 4
    weight = root * root
    m = d.x.size
    average = [np.average(d.u, weights=d.weight_u), np.average(d.v, weights=d.weight_v)]
    spread = float(weight @ (data - np.repeat(average, m)) ** 2)
    variance = max(float(r @ r) / dof, 0.0)
    covariance = variance * _inverse(j.T @ j + prior)
    vortices = p[: 4 * n].reshape(n, 4).copy()
    vortices[:, 3] = np.exp(vortices[:, 3])
    to_radius = np.ones(p.size)
    to_radius[3 : 4 * n : 4] = vortices[:, 3]
    covariance *= np.outer(to_radius, to_radius)
    residual = data - _model(p, n, d, ox, oy)[0]
    explained = 1 - float(r @ r) / spread if spread > 0 else 1.0
    return Fit(vortices, p[4 * n :], covariance, residual[:m], residual[m:], explained)


def _prior(
    start: np.ndarray,
    p: np.ndarray,
    slopes: np.ndarray,
    strain: float,
    rotation: float,
    core: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Inverse covariance and mean of what is expected beforehand of background, core radius and neighbours."""
    unit, mean = np.zeros((p.size, p.size)), np.zeros(p.size)
    unit[3, 3], mean[3] = 1 / core[1] ** 2, np.log(core[0])
    unit[slopes, slopes] = 1 / strain**2
    unit[np.ix_(slopes[1:3], slopes[1:3])] += np.array([[1, -1], [-1, 1]]) / rotation**2
    for k in range(1, len(start)):
        at = np.arange(4 * k, 4 * k + 4)
        mean[at] = p[at]
        spread = NEIGHBOUR_PRIOR * np.array([start[k, 3], start[k, 3], abs(start[k, 2]), 1.0])
        unit[at, at] = 1 / spread**2
    return unit, mean


def _solve(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    scale = 1 / np.sqrt(np.maximum(np.diag(a), 1e-300))
    return scale * np.linalg.lstsq(a * np.outer(scale, scale), scale * b, rcond=1e-14)[0]


def _inverse(a: np.ndarray) -> np.ndarray:
    scale = 1 / np.sqrt(np.maximum(np.diag(a), 1e-300))
    return np.outer(scale, scale) * np.linalg.pinv(a * np.outer(scale, scale), rcond=1e-14, hermitian=True)
