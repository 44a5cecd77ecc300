"""Image filters ahead of the correlation: background removal and the weight of each spatial frequency."""

from __future__ import annotations

import cv2
import numpy as np
import scipy.fft
from scipy.optimize import nnls

from piv.interpolate import kernel_response

TILE = 64  # px: side of the tiles whose spectra are averaged
TAPS = 17  # px: length of the filter kernels


def remove_background(image: np.ndarray, seen: np.ndarray | None, size: int = 15) -> np.ndarray:
    """Image minus its local mean (a triangle of 2·size px), float32; zero where `seen` is False.

    Only seen pixels enter the local mean.
    """

    def blur(field):
        return cv2.blur(cv2.blur(field, (size, size)), (size, size))

    image = image.astype(np.float32)
    if seen is None:
        return image - blur(image)
    weight = seen.astype(np.float32)
    out = image - blur(image * weight) / np.maximum(blur(weight), 1e-6)
    out[~seen] = 0
    return out


def default_response(frequency: np.ndarray, lowpass: float = 0.35) -> np.ndarray:
    """Gaussian low-pass of `lowpass` px: the amplitude response before anything is known of the images."""
    return np.exp(-2 * (np.pi * lowpass * frequency) ** 2)


Kernel = tuple[np.ndarray, np.ndarray]  # along rows, along columns


def kernel(response: np.ndarray) -> Kernel:
    """Filter by `response` that also prepares an image for sampling (piv.interpolate).

    response: amplitude on the rfft2 frequencies of a TILE × TILE field. Any error of the filter is the same for
    both images and moves no vector, so the nearest separable kernel will do.
    """
    f = np.abs(np.fft.fftfreq(TILE))
    # frequencies next to the sampling limit cannot be interpolated: taper them off
    one = np.cos(np.clip((f - 0.36) / 0.14, 0, 1) * np.pi / 2) ** 2 / kernel_response(f)
    full = response * one[:, None] * one[None, : TILE // 2 + 1]
    taps = np.fft.fftshift(np.fft.irfft2(full, s=(TILE, TILE)))
    middle = slice(TILE // 2 - TAPS // 2, TILE // 2 + TAPS // 2 + 1)
    columns, weights, rows = np.linalg.svd(taps[middle, middle])
    root = np.sqrt(weights[0])
    return (rows[0] * root).astype(np.float32), (columns[:, 0] * root).astype(np.float32)


def apply(image: np.ndarray, separable: Kernel) -> np.ndarray:
    """The image filtered, float32; mirrored at its edges."""
    return cv2.sepFilter2D(image, cv2.CV_32F, *separable, borderType=cv2.BORDER_REFLECT_101)


def radial_frequency() -> np.ndarray:
    """|f| (cycles/px) on the rfft2 frequencies of a tile."""
    return np.hypot(np.fft.fftfreq(TILE)[:, None], np.fft.rfftfreq(TILE)[None, :])


def measure_spectra(a: np.ndarray, b: np.ndarray, weight: np.ndarray, tiles: int = 80):
    """Radial spectra of what two aligned images share and of what they do not: (frequency, signal, noise).

    a, b: (rows, columns) aligned images; weight: 1 where both may be used. At most `tiles` tiles, spread evenly
    and free of masked pixels, are averaged. None where there is no such tile.
    """
    rows, columns = a.shape
    y = np.arange(0, rows - TILE + 1, TILE)
    x = np.arange(0, columns - TILE + 1, TILE)
    corners = [(r, c) for r in y for c in x if weight[r : r + TILE, c : c + TILE].min() > 0]
    if not corners:
        return None
    chosen = corners[:: max(1, len(corners) // tiles)]
    taper = np.hanning(TILE + 2)[1:-1].astype(np.float32)
    taper = taper[:, None] * taper[None, :]
    pa = np.stack([a[r : r + TILE, c : c + TILE] for r, c in chosen]) * taper
    pb = np.stack([b[r : r + TILE, c : c + TILE] for r, c in chosen]) * taper
    fa, fb = scipy.fft.rfft2(pa), scipy.fft.rfft2(pb)
    shared = np.sum((fa * fb.conj()).real, axis=0)
    other = 0.5 * np.sum(np.abs(fa - fb) ** 2, axis=0)
    bins = np.rint(radial_frequency() * TILE).astype(int).ravel()
    count = np.bincount(bins)
    signal = np.bincount(bins, shared.ravel()) / count
    noise = np.bincount(bins, other.ravel()) / count
    return np.arange(count.size) / TILE, signal, noise


def undo(response: np.ndarray, spectra: tuple) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spectra (frequency, signal, noise) of images before they were filtered by `response`, below 0.5 cycles/px."""
    frequency, signal, noise = spectra
    below = frequency < 0.5
    along = np.interp(frequency, radial_frequency()[0], response[0]) ** 2
    return frequency[below], (signal / along)[below], (noise / along)[below]


def optimal_response(frequency: np.ndarray, signal: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Amplitude response, on the rfft2 frequencies of a tile, that gives the displacement the least variance.

    The correlation's power weight S/(2SN + N²) is that of the maximum-likelihood delay estimator (Hannan &
    Thomson 1973; Knapp & Carter 1976): white noise leaves it flat until the signal drowns, particles without a
    partner (N ∝ S) make it whiten the spectrum, aliasing cuts its high end. Each image gets the square root.
    """
    signal = np.maximum(signal, 1e-3 * np.maximum(noise, 1e-12 * signal.max()))
    noise = _without_misalignment(frequency, signal, np.maximum(noise, 1e-5 * signal))
    response = np.sqrt(signal / (2 * signal * noise + noise**2))
    response = np.interp(radial_frequency(), frequency[1:], response[1:])
    return response / response.max()


def _without_misalignment(frequency, signal, noise):
    """Noise spectrum less the part that a displacement error of the alignment itself makes, κ f² S."""
    fit = (frequency > 0.06) & (frequency < 0.28)
    f, s, n = frequency[fit], signal[fit], noise[fit]
    # N/S = c + κ f² + n0/S, least squares with non-negative coefficients
    design = np.stack([np.ones_like(f), f**2 / np.mean(f**2), s.mean() / s], axis=1)
    weight = s / n
    c = nnls(design * weight[:, None], np.ones_like(f))[0]
    part = c[1] * frequency**2 / np.mean(f**2) * signal
    return np.maximum(noise - part, 0.1 * noise)
