"""Adaptive smoothing of a vector field: averaged where nothing but noise is seen, untouched where there is more."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

ORDER = 4  # of the low-pass 1 - (1 - L)ⁿ: flat up to its cut-off, steep beyond
SCALES = (1.5, 2.6)  # of its Gaussian L, in σ of the correlation window
LARGEST = 25.0  # variance counted as noise, in medians of the field
NOISE_ONLY, SIGNAL = 1.9, 3.5  # mean square of the fine part over its noise: damped wholly below, kept above


def _gauss(field: np.ndarray, sigma: float) -> np.ndarray:
    return cv2.GaussianBlur(field.astype(np.float32), (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)


def _low_pass(field: np.ndarray, weight: np.ndarray, sigma: float) -> np.ndarray:
    """Low-pass of a masked field, each step a mean over what is known."""
    total = np.maximum(_gauss(weight, sigma), 1e-6)
    out = np.zeros_like(weight)
    for _ in range(ORDER):
        out += _gauss((field - out) * weight, sigma) / total
    return out


def damp_noise(dx, dy, var_x, var_y, known, *, sigma: float, spacing: float, passes: int):
    """Displacements and variances after damping the fine part of the field where it is no stronger than noise.

    For each of SCALES the field is split into a smooth part and the rest e. Where the mean square of e around a
    vector is q times what measurement noise leaves there, e is kept to the share (q - 1.3) within 0 … 1: a Wiener
    filter with known noise (Lee 1980), but with a dead band that spares vortex cores any damping.
    var_x, var_y: variance of the iterated measurement; known: bool; sigma, spacing (px), passes: as measured.
    """
    weight = known.astype(np.float32)
    dx, dy = np.where(known, dx, 0).astype(np.float32), np.where(known, dy, 0).astype(np.float32)
    variance = np.where(known, var_x + var_y, 0)
    if known.any():  # a few vectors that know nothing must not let all around them pass for noise
        variance = np.minimum(variance, LARGEST * np.median(variance[known]))
    shares = noise_shares(sigma, spacing, passes)
    gain = np.ones_like(weight)
    lost = np.zeros_like(weight)
    for scale, (fine, gained) in zip(SCALES, shares, strict=True):
        width = scale * sigma / spacing
        smooth_x, smooth_y = _low_pass(dx, weight, width), _low_pass(dy, weight, width)
        ex, ey = dx - smooth_x, dy - smooth_y
        around = np.maximum(_gauss(weight, 1.3 * width), 1e-6)
        energy = _gauss((ex**2 + ey**2) * weight, 1.3 * width) / around
        noise = _gauss(variance * gain * weight, 1.3 * width) / around * fine
        ratio = energy / np.maximum(noise, 1e-12)
        keep = np.clip((ratio - NOISE_ONLY) / (SIGNAL - NOISE_ONLY), 0, 1)
        dx, dy = smooth_x + keep * ex, smooth_y + keep * ey
        gain = gain * (gained + (1 - gained) * keep)
        lost = lost + (1 - keep) ** 2 * np.maximum(energy - NOISE_ONLY * noise, 0) / 2
    return dx, dy, var_x * gain + lost, var_y * gain + lost


@lru_cache
def noise_shares(sigma: float, spacing: float, passes: int) -> tuple[tuple[float, float], ...]:
    """For each scale: shares of the noise variance held by the fine part, and left when it is damped away."""
    k = np.fft.fftfreq(64)  # per vector
    square = k[:, None] ** 2 + k[None, :] ** 2
    spline = (2 + np.cos(2 * np.pi * k)) / 3
    spline = spline[:, None] * spline[None, :]
    window = np.exp(-2 * np.pi**2 * (sigma / spacing) ** 2 * square)
    total = np.zeros_like(window)
    for _ in range(passes):
        total = spline * total + window * (1 - spline * total)
    power = total**2
    out = []
    for scale in SCALES:
        low = np.exp(-2 * np.pi**2 * (scale * sigma / spacing) ** 2 * square)
        low = 1 - (1 - low) ** ORDER
        out.append(
            (float(np.sum(power * (1 - low) ** 2) / power.sum()), float(np.sum(power * low**2) / power.sum()))
        )
        power = power * low**2
    return tuple(out)
