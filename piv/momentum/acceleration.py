"""Accelerations from neighbouring fields: as many of them as noise asks for and change allows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import ndarray
from scipy.ndimage import gaussian_filter

from piv.vortices.criteria import derivative

REACH = 4  # fields to either side, at most
_SCHEME = "fourth-order"


class Weights(NamedTuple):
    """Time derivative of one instant as a sum of fields.

    numbers: of the fields. values: (field, y, x), 1/s; NaN where too few fields have a vector.
    """

    numbers: ndarray
    values: ndarray


def slope_weights(tau: ndarray, present: ndarray) -> ndarray:
    """Weights (field, y, x) of the derivative at tau = 0 of the parabola fitted to `present`.

    `tau`: (field,) s; `present`: (field, y, x) bool, with the field of tau = 0. Of two fields a
    line; of one NaN.
    """
    scale = float(np.abs(tau).max())
    weights = np.full(present.shape, np.nan)
    code = np.tensordot(2 ** np.arange(len(tau)), present.astype(int), 1)
    for pattern in np.unique(code):
        used = (pattern >> np.arange(len(tau))) & 1 == 1
        if used.sum() < 2:
            continue
        order = min(2, used.sum() - 1)
        row = np.linalg.pinv(np.vander(tau[used] / scale, order + 1, increasing=True))[1] / scale
        full = np.zeros(len(tau))
        full[used] = row
        weights[:, code == pattern] = full[:, None]
    return weights


def time_weights(
    times: ndarray, at: int, present: ndarray, velocity: ndarray, noise: ndarray, width: float
) -> ndarray:
    """Weights (field, y, x) of the time derivative at field `at`, 1/s.

    times: (field,) s; present: (field, y, x); velocity and noise, its standard uncertainty:
    (component, field, y, x), 0 where not `present`. Of the fits over 3, 5, … fields each point
    takes the one with the least mean square error: its noise, and what its difference from the fit
    over 3 shows beyond noise, averaged over `width` grid points (Hausman, Econometrica 46, 1978:
    variances of nested fits subtract).
    """
    variance = np.square(noise)
    fits, errors = [], []
    first = first_noise = np.zeros(0)
    for reach in range(1, REACH + 1):
        low = int(np.clip(at - reach, 0, max(0, len(times) - 2 * reach - 1)))
        near = slice(low, low + 2 * reach + 1)
        weights = np.zeros(present.shape)
        weights[near] = slope_weights(times[near] - times[at], present[near])
        slope = np.einsum("fyx,cfyx->cyx", weights, velocity)
        scatter = np.einsum("fyx,cfyx->cyx", weights**2, variance)
        if reach == 1:
            first, first_noise = slope, scatter
        shown = (slope - first) ** 2 - np.maximum(first_noise - scatter, 0)
        beyond = np.maximum(_mean_over(shown.sum(axis=0), width), 0)
        fits.append(weights)
        errors.append(_mean_over(scatter.sum(axis=0), width) + beyond)
    chosen = np.argmin(errors, axis=0)
    return np.take_along_axis(np.stack(fits), chosen[None, None], axis=0)[0]


def _mean_over(field: ndarray, width: float) -> ndarray:
    known = np.isfinite(field)
    total = gaussian_filter(np.where(known, field, 0.0), width)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(known, total / gaussian_filter(known.astype(float), width), np.inf)


class Flow(NamedTuple):
    """One instant that accelerations are taken about: (y, x) fields, steps in m."""

    u: ndarray
    v: ndarray
    ok: ndarray
    dx: float
    dy: float
    viscosity: float


def acceleration(flow: Flow, slopes: ndarray, u: ndarray, v: ndarray) -> ndarray:
    """Du/Dt less its viscous part: (component, …, y, x), m/s².

    Linear in `slopes` (component, …, y, x), the time derivatives, and in `u`, `v` (…, y, x), of
    which the in-plane gradients are taken: with those of `flow` its acceleration.
    """
    parts = []
    for slope, f in zip(slopes, (u, v), strict=True):
        dx, dy = (
            derivative(f, flow.ok, step, axis + 2, _SCHEME)
            for step, axis in ((flow.dx, -1), (flow.dy, -2))
        )
        part = slope + flow.u * dx + flow.v * dy
        parts.append(part - flow.viscosity * _laplacian(f, flow))
    return np.stack(parts)


def _laplacian(f: ndarray, flow: Flow) -> ndarray:
    """In-plane; 0 along an axis of which a neighbour is missing."""
    total = np.zeros(f.shape)
    for step, axis in ((flow.dx, -1), (flow.dy, -2)):
        g, ok = np.moveaxis(f, axis, -1), np.moveaxis(flow.ok, axis, -1)
        bend = np.zeros(g.shape)
        inner = ok[..., :-2] & ok[..., 1:-1] & ok[..., 2:]
        second = (g[..., :-2] - 2 * g[..., 1:-1] + g[..., 2:]) / step**2
        bend[..., 1:-1] = np.where(inner, second, 0.0)
        total += np.moveaxis(bend, -1, axis)
    return total
