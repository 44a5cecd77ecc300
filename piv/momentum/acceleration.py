"""Accelerations from neighbouring fields: as many of them as noise asks for and change allows."""

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from numpy import ndarray

from piv.vortices.criteria import derivative

REACHES = 1, 2, 4, 8, 16  # fields to either side
# parts of an interval by which the instant of a derivative is not known
BETWEEN, END = 0.2, 0.5
# correlation lengths over which the error of a time derivative is averaged before it is judged:
# shorter errors cancel in a pressure. Of 2, 3, 4 the one of least error in exact flows whose errors
# neighbours share, at 250, 500 and 1000 Hz (seeds 201-206; no command repeats it)
WIDE = 2.0
_DEVIATIONS = 3  # of the noise of such means above their own, up to which a difference is noise
_SCHEME = "fourth-order"


def _parabola_weights(tau: ndarray, present: ndarray) -> ndarray:
    """Weights (derivative, field, y, x): first and second, at tau = 0, of a parabola in time.

    It is fitted to the `present` fields. `tau`: (field,) s; `present`: (field, y, x) bool, with the
    field of tau = 0. Of two fields a line; of one NaN.
    """
    scale = float(np.abs(tau).max())
    weights = np.full((2, *present.shape), np.nan)
    code = np.tensordot(2 ** np.arange(len(tau)), present.astype(int), 1)
    for pattern in np.unique(code):
        used = (pattern >> np.arange(len(tau))) & 1 == 1
        if used.sum() < 2:
            continue
        powers = np.vander(tau[used] / scale, min(3, used.sum()), increasing=True)
        rows = np.zeros((2, len(tau)))
        rows[: powers.shape[1] - 1, used] = np.linalg.pinv(powers)[1:]
        weights[:, :, code == pattern] = (rows / [[scale], [scale**2 / 2]])[:, :, None]
    return weights


class Field(NamedTuple):
    """Vectors of one instant: (component, y, x) m/s, 0 where `ok` is not; their uncertainty."""

    velocity: ndarray
    std: ndarray
    ok: ndarray


class Slope(NamedTuple):
    """A time derivative: `weights` (field, y, x) of the fields `near`, 1/s.

    value, its variance, and lack, what it lacks (m/s²): (component, y, x).
    """

    near: range
    weights: ndarray
    value: ndarray
    variance: ndarray
    lack: ndarray


def time_slope(times: ndarray, at: int, fields: Callable[[int], Field], length: float) -> Slope:
    """The time derivative at field `at` of the series `fields` at `times` (s).

    length: grid points over which errors hang together. Parabolas are fitted over `REACHES` fields
    to either side. The fit of least mean square error over `WIDE` of those lengths is taken, since
    shorter errors leave little in a pressure. That error has two parts. One is the fit's noise in
    most of the view. The other is what its difference from any shorter fit has beyond that fit's
    noise (Goldenshluger and Lepski, Ann. Stat. 39, 2011). The lack is the change of the derivative
    over a part of an interval: a derivative of two fields belongs to any instant between them.
    """
    means: list[ndarray] = []
    noises: list[float] = []
    errors: list[float] = []
    ok = fields(at).ok
    # left of errors correlated by exp(-2 (d/length)²) in a mean over a Gaussian of `WIDE` lengths
    share = 1 / (1 + 8 * WIDE**2)
    # so far may a square exceed that noise, of as many means as the view holds
    most = 1 + _DEVIATIONS * np.sqrt(4 * np.pi * (WIDE * length) ** 2 / ok.sum())
    for reach in REACHES:
        low = int(np.clip(at - reach, 0, max(0, len(times) - 2 * reach - 1)))
        near = range(low, min(low + 2 * reach + 1, len(times)))
        some = [fields(k) for k in near]
        present = np.stack([one.ok for one in some]) & ok
        velocity, noise = (np.stack([one[part] for one in some], axis=1) for part in (0, 1))
        weights, curvature = _parabola_weights(times[near] - times[at], present)
        slope = np.einsum("fyx,cfyx->cyx", weights, velocity)
        variance = np.einsum("fyx,cfyx->cyx", weights**2, np.square(noise))
        known = np.isfinite(slope).all(axis=0)
        mean = _mean_over(slope, known, WIDE * length)[:, ok]
        biases = [
            2 * np.square(mean - shorter).mean() - most * own
            for shorter, own in zip(means, noises, strict=True)
        ]
        means.append(mean)
        seen = variance.sum(axis=0)[known]
        noises.append(share * float(np.median(seen)) if seen.size else np.inf)
        errors.append(noises[-1] + max([0.0, *biases]))
        if errors[-1] == min(errors):
            bend = np.einsum("fyx,cfyx->cyx", curvature, velocity)
            best = near, weights, slope, variance, known, bend
        if errors[-1] > 2 * min(errors) or len(near) == len(times):
            break
    middle = min(max(at, 1), len(times) - 2)
    part = (END if middle != at else BETWEEN) * (times[middle + 1] - times[middle - 1]) / 2
    near, weights, slope, variance, known, bend = best
    lack = np.where(known, part * _mean_over(bend, known, WIDE * length / 2), 0.0)
    return Slope(near, weights, slope, variance, lack)


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
