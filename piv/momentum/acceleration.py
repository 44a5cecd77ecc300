"""Accelerations from neighbouring fields: as many of them as noise asks for and change allows."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy import ndarray

from piv.vortices.criteria import derivative

REACH = 4  # fields to either side, at most
# parts of an interval by which the instant of a derivative is not known
BETWEEN, END = 0.2, 0.5
# correlation lengths over which the error of a time derivative is averaged before it is judged:
# shorter errors cancel in a pressure
WIDE = 4.0
_SCHEME = "fourth-order"


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
    times: ndarray, at: int, present: ndarray, velocity: ndarray, noise: ndarray, length: float
) -> tuple[ndarray, ndarray]:
    """Weights (field, y, x) of the time derivative at field `at`, 1/s; what it lacks, m/s².

    times: (field,) s; present: (field, y, x); velocity and noise, its standard uncertainty:
    (component, field, y, x), 0 where not `present`; length: grid points over which errors hang
    together. Of the fits over 3, 5, … fields the one with the least mean square error over `WIDE`
    of those lengths, for shorter errors leave little in a pressure: its noise in most of the view,
    and its difference from the fit over 3, which changes of the flow bend least. What it lacks
    (component, y, x): the change of the derivative over a part of an interval, for a derivative of
    two fields belongs to any instant between them.
    """
    fits, slopes, scatters = [], [], []
    for reach in range(1, REACH + 1):
        low = int(np.clip(at - reach, 0, max(0, len(times) - 2 * reach - 1)))
        near = slice(low, low + 2 * reach + 1)
        weights = np.zeros(present.shape)
        weights[near] = slope_weights(times[near] - times[at], present[near])
        fits.append(weights)
        slopes.append(np.einsum("fyx,cfyx->cyx", weights, velocity))
        scatters.append(np.einsum("fyx,cfyx->yx", weights**2, np.square(noise)))
    known = np.isfinite(slopes[0]).all(axis=0)
    # left of errors correlated by exp(-2 (d/length)²) in a mean over a Gaussian of `WIDE` lengths
    share = 1 / (1 + 8 * WIDE**2)
    noises = [share * float(np.median(scatter[known])) for scatter in scatters]
    apart = np.concatenate([slope - slopes[0] for slope in slopes])
    apart = _mean_over(apart, known, WIDE * length)[:, known].reshape(len(fits), -1)
    errors = noises + 2 * np.square(apart).mean(axis=1)
    middle = min(max(at, 1), len(times) - 2)
    before, now, after = (velocity[:, middle + k] for k in (-1, 0, 1))
    all_three = np.logical_and.reduce(present[middle - 1 : middle + 2])
    change = _mean_over((before - 2 * now + after), all_three, WIDE * length / 2)
    part = (END if middle != at else BETWEEN) * 2 / (times[middle + 1] - times[middle - 1])
    return fits[int(np.argmin(errors))], np.where(all_three, part * change, 0.0)


def _mean_over(fields: ndarray, known: ndarray, width: float) -> ndarray:
    """Gaussian means over `known` values of a stack (component, y, x)."""
    stack = np.where(known, np.concatenate([fields, known[None]]), 0.0).astype(np.float32)
    blurred = cv2.GaussianBlur(np.moveaxis(stack, 0, -1), (0, 0), width)
    return np.moveaxis(blurred[..., :-1] / np.maximum(blurred[..., -1:], 1e-9), -1, 0)


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
