"""First passes: cross-correlation of windows by FFT, shifted by whole pixels of a predictor."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.fft
from numba import njit

BATCH = 2**16  # px: windows that are transformed together fit a core's cache


class Peaks(NamedTuple):
    """Displacement (px, image axes) of the highest and the second-highest peak of each window."""

    dx: np.ndarray
    dy: np.ndarray
    second_x: np.ndarray
    second_y: np.ndarray


@njit(cache=True, nogil=True, fastmath=True)
def _cut(image, centre_x, centre_y, size, out):
    """Windows of `size` px around the given pixels, their mean removed, of unit energy; zero outside the image."""
    rows, columns = image.shape
    half = size // 2
    for k in range(centre_x.size):
        x0, y0 = centre_x[k] - half, centre_y[k] - half
        r0, r1 = max(0, -y0), min(size, rows - y0)
        c0, c1 = max(0, -x0), min(size, columns - x0)
        out[k] = 0
        if r1 <= r0 or c1 <= c0:
            continue
        total = np.float32(0)
        for r in range(r0, r1):
            for c in range(c0, c1):
                total += image[y0 + r, x0 + c]
        mean = total / np.float32((r1 - r0) * (c1 - c0))
        energy = np.float32(0)
        for r in range(r0, r1):
            for c in range(c0, c1):
                value = image[y0 + r, x0 + c] - mean
                out[k, r, c] = value
                energy += value * value
        if energy > 0:
            scale = np.float32(1) / np.sqrt(energy)
            for r in range(r0, r1):
                for c in range(c0, c1):
                    out[k, r, c] *= scale


def window_maps(a, b, x, y, shift_x, shift_y, size: int) -> np.ndarray:
    """Correlation coefficients (window, size, size) of windows around the pixels (x, y), zero shift at [0, 0].

    a, b: float32 images, zero where nothing is to be seen; shift_x, shift_y: whole pixels by which the second
    window is moved against the first, half each way, so that the vector belongs to (x, y) to half a pixel.
    """
    ax, ay = x - shift_x // 2, y - shift_y // 2
    bx, by = ax + shift_x, ay + shift_y
    maps = np.empty((x.size, size, size), np.float32)
    some = max(BATCH // size**2, 1)
    wa, wb = (np.empty((min(some, x.size), size, size), np.float32) for _ in range(2))
    for k in range(0, x.size, some):
        n = slice(k, min(k + some, x.size))
        count = n.stop - k
        _cut(a, ax[n], ay[n], size, wa[:count])
        _cut(b, bx[n], by[n], size, wb[:count])
        fa, fb = scipy.fft.rfft2(wa[:count]), scipy.fft.rfft2(wb[:count])
        np.conjugate(fa, out=fa)
        fa *= fb
        maps[n] = scipy.fft.irfft2(fa, s=(size, size), overwrite_x=True)
    return maps


@njit(cache=True, nogil=True)
def _subpixel(below, peak, above):
    """Gaussian three-point offset of a peak; parabola where a value is not positive."""
    if below > 0 and above > 0 and peak > 0:
        b, p, a = np.log(below), np.log(peak), np.log(above)
    else:
        b, p, a = below, peak, above
    curvature = b - 2 * p + a
    if curvature >= 0:
        return 0.0
    return min(max(0.5 * (b - a) / curvature, -0.5), 0.5)


@njit(cache=True, nogil=True)
def _peaks(maps, reach, dx, dy, second_x, second_y):
    count, size, _ = maps.shape
    for k in range(count):
        best = second = np.float32(-1e30)
        br = bc = sr = sc = 0
        for r in range(-reach, reach + 1):
            for c in range(-reach, reach + 1):
                if maps[k, r % size, c % size] > best:
                    best, br, bc = maps[k, r % size, c % size], r, c
        for r in range(-reach, reach + 1):
            for c in range(-reach, reach + 1):
                value = maps[k, r % size, c % size]
                # a local maximum away from the first peak: its slope is not a second one
                if (
                    value > second
                    and (abs(r - br) > 2 or abs(c - bc) > 2)
                    and value >= maps[k, (r - 1) % size, c % size]
                    and value >= maps[k, (r + 1) % size, c % size]
                    and value >= maps[k, r % size, (c - 1) % size]
                    and value >= maps[k, r % size, (c + 1) % size]
                ):
                    second, sr, sc = value, r, c
        for pick in range(2):
            r, c = (br, bc) if pick == 0 else (sr, sc)
            peak = maps[k, r % size, c % size]
            x = c + _subpixel(maps[k, r % size, (c - 1) % size], peak, maps[k, r % size, (c + 1) % size])
            y = r + _subpixel(maps[k, (r - 1) % size, c % size], peak, maps[k, (r + 1) % size, c % size])
            if pick == 0:
                dx[k], dy[k] = x, y
            else:
                second_x[k], second_y[k] = x, y


def find_peaks(maps: np.ndarray, shift_x: np.ndarray, shift_y: np.ndarray, reach: int) -> Peaks:
    """The two highest peaks within ±reach px of the shift that `window_maps` was given."""
    peaks = Peaks(*(np.empty(maps.shape[0], np.float32) for _ in range(4)))
    _peaks(maps, reach, *peaks)
    return Peaks(peaks.dx + shift_x, peaks.dy + shift_y, peaks.second_x + shift_x, peaks.second_y + shift_y)
