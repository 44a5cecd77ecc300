"""Filters of the images: the frequency weights of the correlation, from the images' spectra."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
import scipy.fft
from numpy import float32, ndarray
from scipy.optimize import nnls

from piv.correlation.cell_moments import CELL
from piv.correlation.interpolate import kernel_response
from piv.correlation.options import Options

TILE = 64  # px: side of the tiles whose spectra are averaged
TILES = 50  # so many of them: a radial bin is then known to some per cent
TAPS = 17  # px: length of the filter kernels
# penalty on frequencies to which sampling has folded power, over the signal's: times the squares of
# the folded share there and at 0.25 cycles/px. Set so that the bias of particles of 1.2 and 1.6 px
# halves and that of 2.5 px stays; no theory gives it
FOLDED = 2500.0
_TAPERED = 2.25  # frequencies of a tapered tile per independent one: 1.5 each way of Hann's window
# px²: fall of the log of the spectrum with the squared frequency, of images 2.5 px wide (π² d²/4),
# and its usual spread
_USUAL, _SPREAD = 15.0, 6.0
DROWNED = 2.0  # standard errors of a signal for which measurement and usual spectrum count alike
# least correlation of a window over that of noise, and share of the option's value at the lowest
CHANCE, LOWEST = 2.2, 0.5
_LOWPASS = 0.35  # px: of the Gaussian before the spectra are measured


Kernel = tuple[ndarray, ndarray]  # along rows, along columns
# variance of noise in 3 x 3 cells over nine times that of one, with the default filter; measured
# once, no command repeats it
CELL_NOISE = 1.15


class Filter(NamedTuple):
    """Frequency weights of both images, and the kernel that filters an image by them."""

    response: ndarray  # amplitude on the rfft2 frequencies of a tile
    kernel: Kernel
    cell_noise: float = CELL_NOISE
    independent: float = 0.0  # pixels of noise per pixel that do not correlate; 0: not measured

    def least_correlation(self, sigma: float, usual: float) -> float:
        """Correlation below which a window of `sigma` px shows chance, at most `usual`.

        Wide filters let in noise that lowers every correlation, chance ones most.
        """
        if not self.independent:
            return usual
        noise = 1 / np.sqrt(4 * np.pi * sigma**2 * self.independent)
        return usual * float(np.clip(CHANCE * noise / Options.min_correlation, LOWEST, 1))


def default_filter() -> Filter:
    """Return the filter that is used before the spectra are measured."""
    response = np.exp(-2 * (np.pi * _LOWPASS * _radial_frequency()) ** 2)
    return Filter(response, _kernel(response))


def best_filter(powers: list[Powers], before: Filter) -> Filter:
    """Return the maximum-likelihood filter by the powers of images that `before` has filtered.

    Without powers, or where the measured tiles are black, the filter stays.
    """
    if not any(np.any(cross) for cross, _, _ in powers):
        return before
    frequency, signal, noise, error = _undo(before.response, radial_spectra(powers))
    spectra = frequency, _likely_signal(frequency, signal, error), noise
    response = _optimal_response(*spectra)
    power = (response * _taper()) ** 2
    power = np.concatenate([power, power[:, 1:-1]], axis=1)  # all frequencies
    independent = float(power.sum() ** 2 / (power**2).sum() / power.size)
    return Filter(response, _kernel(response), _cell_noise(spectra, response), independent)


def _kernel(response: ndarray) -> Kernel:
    """Filter by `response` that also prepares an image for sampling (piv.correlation.interpolate).

    response: amplitude on the rfft2 frequencies of a TILE × TILE field. Any error of the filter is
    the same for both images and moves no vector, so the nearest separable kernel will do.
    """
    one = 1 / kernel_response(np.abs(np.fft.fftfreq(TILE)))
    full = response * _taper() * one[:, None] * one[None, : TILE // 2 + 1]
    taps = np.fft.fftshift(np.fft.irfft2(full, s=(TILE, TILE)))
    middle = slice(TILE // 2 - TAPS // 2, TILE // 2 + TAPS // 2 + 1)
    columns, weights, rows = np.linalg.svd(taps[middle, middle])
    root = np.sqrt(weights[0])
    return (rows[0] * root).astype(float32), (columns[:, 0] * root).astype(float32)


def apply(image: ndarray, separable: Kernel, out: ndarray | None = None) -> ndarray:
    """The image filtered, float32, in `out` if given; mirrored at its edges."""
    return cv2.sepFilter2D(
        image, cv2.CV_32F, *separable, dst=out, borderType=cv2.BORDER_REFLECT_101
    )


@lru_cache
def _radial_frequency() -> ndarray:
    """|f| (cycles/px) on the rfft2 frequencies of a tile."""
    return np.hypot(np.fft.fftfreq(TILE)[:, None], np.fft.rfftfreq(TILE)[None, :])


def tile_rows(rows: int, columns: int, seen: ndarray | None) -> ndarray:
    """First rows of strips, spread over the image, with about TILES tiles free of masked pixels."""
    first = np.arange(0, rows - TILE + 1, TILE)
    whole = np.full(first.size, columns // TILE)
    if seen is not None:
        across = columns // TILE * TILE
        whole = np.array(
            [seen[r : r + TILE, :across].all(0).reshape(-1, TILE).all(1).sum() for r in first]
        )
    first, whole = first[whole > 0], whole[whole > 0]
    count = min(first.size, int(np.ceil(TILES / max(whole.mean(), 1)))) if first.size else 0
    return first[((np.arange(count) + 0.5) * first.size / max(count, 1)).astype(int)]


# sums over tiles of the cross power and of half the power of the difference, number of tiles
Powers = tuple[ndarray, ndarray, int]


def strip_powers(a: ndarray, b: ndarray, weight: ndarray) -> Powers | None:
    """Powers of the unmasked tiles of two aligned strips (TILE, columns); None without any."""
    across = a.shape[1] // TILE * TILE
    whole = (weight[:, :across].min(axis=0) > 0).reshape(-1, TILE).all(axis=1)
    if not whole.any():
        return None
    taper = np.hanning(TILE + 2)[1:-1].astype(float32)
    taper = taper[:, None] * taper[None, :]
    tiles = (i[:, :across].reshape(TILE, -1, TILE).swapaxes(0, 1)[whole] for i in (a, b))
    fa, fb = (scipy.fft.rfft2(t * taper) for t in tiles)
    difference = fa - fb
    return (
        np.sum(fa.real * fb.real + fa.imag * fb.imag, axis=0),
        0.5 * np.sum(difference.real**2 + difference.imag**2, axis=0),
        len(fa),
    )


def radial_spectra(powers: list[Powers]) -> tuple[ndarray, ndarray, ndarray, ndarray]:
    """Radial spectra (frequency, signal, noise, standard error of the signal) of aligned images."""
    cross, difference, tiles = (sum(parts) for parts in zip(*powers, strict=True))
    bins = np.rint(_radial_frequency() * TILE).astype(int).ravel()
    count = np.bincount(bins)
    signal, noise = (np.bincount(bins, p.ravel()) / count for p in (cross, difference))
    samples = count * tiles / _TAPERED
    noise = np.maximum(noise, 1e-9 * np.abs(signal).max())  # equal images have none
    error = np.sqrt((np.maximum(signal, 0) * noise + noise**2 / 2) / samples)
    return np.arange(count.size) / TILE, signal, noise, error


def _undo(response: ndarray, spectra: tuple) -> tuple[ndarray, ...]:
    """Spectra (the frequency first) of images before the filter `response`."""
    frequency, *parts = spectra
    below = frequency < 0.5
    along = np.interp(frequency, _radial_frequency()[0], response[0]) ** 2
    return frequency[below], *((part / along)[below] for part in parts)


def _likely_signal(frequency: ndarray, signal: ndarray, error: ndarray) -> ndarray:
    """The signal, and a Gaussian spectrum fitted to it where it drowns in its standard `error`.

    There chance would pass for signal, and so let in or shut out noise by frequency.
    """
    fit = (frequency > 0.04) & (frequency < 0.42)
    weight, widths = 1 / error[fit] ** 2, np.arange(4.0, 40.0, 2.0)
    shapes = np.exp(-widths[:, None] * frequency**2)
    near = shapes[:, fit]
    height = np.maximum((near * signal[fit] * weight).sum(1) / (near**2 * weight).sum(1), 0)
    left = ((signal[fit] - height[:, None] * near) ** 2 * weight).sum(1)
    best = np.argmin(left + ((widths - _USUAL) / _SPREAD) ** 2)
    fitted = height[best] * shapes[best]
    known = (fitted / (DROWNED * error)) ** 2
    return (known * signal + fitted) / (known + 1)


def _optimal_response(frequency: ndarray, signal: ndarray, noise: ndarray) -> ndarray:
    """Amplitude response on a tile's rfft2 frequencies that gives the least variance.

    The correlation's power weight S/(2SN + N²) is that of the maximum-likelihood delay estimator
    (Hannan & Thomson 1973; Knapp & Carter 1976): white noise leaves it flat until the signal
    drowns, particles without a partner (N ∝ S) make it whiten the spectrum. What sampling has
    folded back biases all cells of a window alike and is no noise: FOLDED is a penalty on it. Each
    image gets the square root.
    """
    signal, noise = _aligned(frequency, signal, noise)
    folded = _folded_share(frequency, signal)
    noise = noise + FOLDED * (np.interp(0.25, frequency, folded) * folded) ** 2 * signal
    response = np.sqrt(signal / (2 * signal * noise + noise**2))
    response = np.interp(_radial_frequency(), frequency[1:], response[1:])
    return response / response.max()


def _folded_share(frequency: ndarray, signal: ndarray) -> ndarray:
    """Power that sampling has folded back to each frequency, over that which belongs there.

    The spectrum of particle images is taken for Gaussian; its width is fitted where hardly any
    power is folded.
    """
    fit = (frequency > 0.06) & (frequency < 0.2)
    slope = -np.polyfit(frequency[fit] ** 2, np.log(signal[fit]), 1)[0]
    return np.exp(-max(slope, 0.0) * (1 - 2 * frequency))


def _cell_noise(spectra: tuple, response: ndarray) -> float:
    """Noise variance of the gradient's sum over 3 x 3 cells, over nine times that of one cell.

    spectra: (frequency, signal, noise) of the images before they are filtered by `response`. Along
    x, g = (s ∂n - n ∂s)/2 for the signal s and the noise n of the difference, and the product of
    both images' own noise.
    """
    frequency, signal, noise = spectra
    power = (response * _taper()) ** 2
    power[0, 0] = 0
    parts = [
        np.interp(_radial_frequency(), frequency, p) * power
        for p in _aligned(frequency, signal, noise)
    ]
    along = 2j * np.pi * np.fft.rfftfreq(TILE)[None, :]
    (s, s1, s2), (n, n1, n2) = (
        [np.fft.irfft2(p * along**m, s=(TILE, TILE)) for m in range(3)] for p in parts
    )
    # its autocorrelation, but for a factor
    gradient = 2 * s1 * n1 - s * n2 - n * s2 + n1**2 - n * n2
    window = np.abs(np.fft.fft(np.ones(CELL), TILE)) ** 2
    lags = np.fft.ifft2(np.fft.fft2(gradient) * np.outer(window, window)).real[::CELL, ::CELL]
    return float((lags[0, 0] + 2 * lags[0, 1] + 2 * lags[1, 0] + 4 * lags[1, 1]) / lags[0, 0])


@lru_cache
def _taper() -> ndarray:
    """Taper of the frequencies next to the sampling limit, which cannot be interpolated."""
    one = np.cos(np.clip((np.abs(np.fft.fftfreq(TILE)) - 0.36) / 0.14, 0, 1) * np.pi / 2) ** 2
    return one[:, None] * one[None, : TILE // 2 + 1]


def _aligned(frequency, signal, noise) -> tuple[ndarray, ndarray]:
    """Signal and noise spectra, positive; the noise without the share of misalignment."""
    signal = np.maximum(signal, 1e-3 * np.maximum(noise, 1e-12 * signal.max()))
    return signal, _without_misalignment(frequency, signal, np.maximum(noise, 1e-5 * signal))


def _without_misalignment(frequency, signal, noise):
    """Noise spectrum less the part κ f² S that comes from misalignment."""
    fit = (frequency > 0.06) & (frequency < 0.28)
    f, s, n = frequency[fit], signal[fit], noise[fit]
    # N/S = c + κ f² + n0/S, least squares with non-negative coefficients
    design = np.stack([np.ones_like(f), f**2 / np.mean(f**2), s.mean() / s], axis=1)
    weight = s / n
    c = nnls(design * weight[:, None], np.ones_like(f))[0]
    part = c[1] * frequency**2 / np.mean(f**2) * signal
    return np.maximum(noise - part, 0.1 * noise)
