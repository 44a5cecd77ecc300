"""Adaptive smoothing of a vector field: noise is averaged away where nothing but noise is seen."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np


def _gauss(field: np.ndarray, sigma: float) -> np.ndarray:
    return cv2.GaussianBlur(field, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)


def _flat(field, weight, total, sigma):
    """Low-pass L(2 - L) of a masked field, L a Gaussian: its response falls off with the fourth power only."""
    once = _gauss(field * weight, sigma) / total
    return once + _gauss((field - once) * weight, sigma) / total


def adaptive(dx, dy, var_x, var_y, known, passed: tuple[float, float], *, sigma: float, strictness: float = 1.5):
    """Displacements with the fine part of the field damped where it is no stronger than its noise.

    The field is split into a smooth part S and the rest e = d - S. Where the mean square of e over a neighbourhood
    is q times what measurement noise alone would leave there, e is kept to the share max(0, 1 - strictness/q)
    (Wiener's filter with a known noise level; Lee 1980). A steep vortex core has a large q and is not touched.
    known: bool, vectors that count; var_x, var_y: variance of each vector; passed: (share of the noise variance
    that e holds, share that S holds). Returns (dx, dy, var_x, var_y).
    """
    weight = known.astype(np.float32)
    total = np.maximum(_gauss(weight, sigma), 1e-6)
    wide = 2.0 * sigma
    around = np.maximum(_gauss(weight, wide), 1e-6)
    smooth = [_flat(np.where(known, d, 0).astype(np.float32), weight, total, sigma) for d in (dx, dy)]
    rest = [np.where(known, d - s, 0) for d, s in zip((dx, dy), smooth, strict=True)]
    energy = _gauss((rest[0] ** 2 + rest[1] ** 2).astype(np.float32) * weight, wide) / around
    noise = passed[0] * _gauss(np.where(known, var_x + var_y, 0).astype(np.float32) * weight, wide) / around
    keep = np.clip(1 - strictness * noise / np.maximum(energy, 1e-12), 0, 1)
    out = [np.where(known, s + keep * e, d) for s, e, d in zip(smooth, rest, (dx, dy), strict=True)]
    # noise of what is kept, and what damping removed of a field that was there
    lost = np.maximum(energy - noise, 0) / 2 * (1 - keep) ** 2
    gain = passed[1] + 2 * keep * np.sqrt(passed[0] * passed[1]) * 0 + keep**2 * passed[0]
    return (*out, var_x * gain + lost, var_y * gain + lost)


@lru_cache
def noise_shares(sigma_nodes: float, window_nodes: float, passes: int) -> tuple[float, float, float]:
    """(share of noise variance in e, share in S, variance of the iterated measurement over that of one).

    window_nodes: σ of the correlation window in vector spacings; passes: Newton steps at full resolution, each
    of which adds G(noise - P d) to P d with the window's response G and the predictor's B-spline response P.
    """
    k = np.fft.fftfreq(64)
    square = k[:, None] ** 2 + k[None, :] ** 2
    spline = (2 + np.cos(2 * np.pi * k)) / 3
    window = np.exp(-2 * np.pi**2 * window_nodes**2 * square)
    total = np.zeros_like(window)
    for _ in range(passes):
        predicted = spline[:, None] * spline[None, :] * total
        total = predicted + window * (1 - predicted)
    low = np.exp(-2 * np.pi**2 * sigma_nodes**2 * square)
    low = low * (2 - low)
    power = total**2
    return (
        float(np.sum(power * (1 - low) ** 2) / power.sum()),
        float(np.sum(power * low**2) / power.sum()),
        float(power.sum() / np.sum(window**2)),
    )
