"""First passes: cross-correlation of windows by FFT, shifted by whole pixels of a predictor."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.fft
from numpy import float32, ndarray

from piv.compiled import compiled, fast

BATCH = 2**17  # px of windows transformed together: more do not fit a core's cache


class Peaks(NamedTuple):
    """Displacement (px, image axes) of the highest and the second-highest peak of each window."""

    dx: ndarray
    dy: ndarray
    second_x: ndarray
    second_y: ndarray


@fast
def _total(row):
    total = float32(0)
    for value in row:
        total += value
    return total


@fast
def _less(row, mean, out):
    """Set `out` to the row less `mean`; its energy."""
    energy = float32(0)
    for i in range(out.size):
        value = row[i] - mean
        out[i] = value
        energy += value * value
    return energy


@fast
def _cut(image, centre_x, centre_y, size, out):
    """Windows of `size` px round pixels, of zero mean and unit energy; zero outside the image."""
    rows, columns = image.shape
    half = size // 2
    for k in range(centre_x.size):
        x0, y0 = centre_x[k] - half, centre_y[k] - half
        r0, r1 = max(0, -y0), min(size, rows - y0)
        c0, c1 = max(0, -x0), min(size, columns - x0)
        out[k] = 0
        if r1 <= r0 or c1 <= c0:
            continue
        total = float32(0)
        for r in range(r0, r1):
            total += _total(image[y0 + r, x0 + c0 : x0 + c1])
        mean = total / float32((r1 - r0) * (c1 - c0))
        energy = float32(0)
        for r in range(r0, r1):
            energy += _less(image[y0 + r, x0 + c0 : x0 + c1], mean, out[k, r, c0:c1])
        if energy > 0:
            scale = float32(1) / np.sqrt(energy)
            out[k] *= scale


def window_maps(a, b, x, y, shift_x, shift_y, size: int) -> ndarray:
    """Correlation (window, size, size) of windows round pixels (x, y), zero shift at [0, 0].

    a, b: float32 images, zero where masked; shift_x, shift_y: whole pixels by which the second
    window is moved against the first, half each way: the vector belongs to (x, y) to half a pixel.
    """
    ax, ay = x - shift_x // 2, y - shift_y // 2
    bx, by = ax + shift_x, ay + shift_y
    maps = np.empty((x.size, size, size), float32)
    some = min(max(BATCH // size**2, 1), x.size)
    windows = np.empty((2, some, size, size), float32)
    for k in range(0, x.size, some):
        n = slice(k, min(k + some, x.size))
        count = n.stop - k
        _cut(a, ax[n], ay[n], size, windows[0])
        _cut(b, bx[n], by[n], size, windows[1])
        first, second = scipy.fft.rfft2(windows[:, :count])
        np.conjugate(first, out=first)
        first *= second
        maps[n] = scipy.fft.irfft2(first, s=(size, size), overwrite_x=True)
    return maps


@compiled
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


@fast
def _highest(row):
    highest = float32(-1e30)
    for value in row:
        highest = max(highest, value)
    return highest


@compiled
def _peaks(maps, reach, dx, dy, second_x, second_y):
    count, size, _ = maps.shape
    side = reach + 1
    near = np.empty((2 * side + 1, 2 * side + 1), float32)  # the map around zero shift
    inner = slice(1, 2 * reach + 2)
    for k in range(count):
        for r in range(-side, side + 1):
            row = maps[k, r % size]
            near[r + side, :side] = row[size - side :]
            near[r + side, side:] = row[: side + 1]
        best = second = float32(-1e30)
        # a map of one value has its peak in the middle
        br = bc = sr = sc = side
        for r in range(1, 2 * reach + 2):
            if _highest(near[r, inner]) > best:
                for c in range(1, 2 * reach + 2):
                    if near[r, c] > best:
                        best, br, bc = near[r, c], r, c
        for r in range(1, 2 * reach + 2):
            if not _highest(near[r, inner]) > second:
                continue
            for c in range(1, 2 * reach + 2):
                value = near[r, c]
                # a local maximum away from the first peak, not on its slope
                if (
                    value > second
                    and (abs(r - br) > 2 or abs(c - bc) > 2)
                    and value >= near[r - 1, c]
                    and value >= near[r + 1, c]
                    and value >= near[r, c - 1]
                    and value >= near[r, c + 1]
                ):
                    second, sr, sc = value, r, c
        for r, c, x, y in ((br, bc, dx, dy), (sr, sc, second_x, second_y)):
            x[k] = c - side + _subpixel(near[r, c - 1], near[r, c], near[r, c + 1])
            y[k] = r - side + _subpixel(near[r - 1, c], near[r, c], near[r + 1, c])


def find_peaks(maps: ndarray, shift_x: ndarray, shift_y: ndarray, reach: int) -> Peaks:
    """The two highest peaks within ±reach px of the shift that `window_maps` was given."""
    peaks = Peaks(*(np.empty(maps.shape[0], float32) for _ in range(4)))
    _peaks(maps, reach, *peaks)
    return Peaks(
        peaks.dx + shift_x, peaks.dy + shift_y, peaks.second_x + shift_x, peaks.second_y + shift_y
    )
