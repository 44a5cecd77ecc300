"""First passes: cross-correlation of windows by FFT, shifted by whole pixels of a predictor."""

from __future__ import annotations

import numpy as np
import scipy.fft
from numba import njit


@njit(cache=True, nogil=True)
def _cut(image, centre_x, centre_y, size, out):
    """Windows of `size` px around the given pixels, their mean removed; zero outside the image."""
    rows, columns = image.shape
    half = size // 2
    for k in range(centre_x.size):
        x0, y0 = centre_x[k] - half, centre_y[k] - half
        total = np.float32(0)
        seen = 0
        for r in range(size):
            y = y0 + r
            for c in range(size):
                x = x0 + c
                if 0 <= y < rows and 0 <= x < columns:
                    out[k, r, c] = image[y, x]
                    total += image[y, x]
                    seen += 1
                else:
                    out[k, r, c] = 0
        if seen == 0:
            continue
        mean = total / seen
        for r in range(max(0, -y0), min(size, rows - y0)):
            for c in range(max(0, -x0), min(size, columns - x0)):
                out[k, r, c] -= mean


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
def _peaks(maps, reach, offset_x, offset_y, second_x, second_y, ratio, height):
    """Highest and second-highest peak of circular correlation maps within ±reach px."""
    count, size, _ = maps.shape
    for k in range(count):
        best = second = np.float32(-1e30)
        br = bc = sr = sc = 0
        for pick in range(2):
            for r in range(-reach, reach + 1):
                for c in range(-reach, reach + 1):
                    value = maps[k, r % size, c % size]
                    if pick == 0:
                        if value > best:
                            best, br, bc = value, r, c
                    elif value > second and (abs(r - br) > 2 or abs(c - bc) > 2):
                        # a local maximum only: the slope of the first peak is not a second one
                        if (
                            value >= maps[k, (r - 1) % size, c % size]
                            and value >= maps[k, (r + 1) % size, c % size]
                            and value >= maps[k, r % size, (c - 1) % size]
                            and value >= maps[k, r % size, (c + 1) % size]
                        ):
                            second, sr, sc = value, r, c
        offset_x[k] = bc + _subpixel(
            maps[k, br % size, (bc - 1) % size], best, maps[k, br % size, (bc + 1) % size]
        )
        offset_y[k] = br + _subpixel(
            maps[k, (br - 1) % size, bc % size], best, maps[k, (br + 1) % size, bc % size]
        )
        second_x[k], second_y[k] = sc, sr
        ratio[k] = best / max(second, np.float32(1e-20)) if second > 0 else np.float32(100)
        height[k] = best


def correlate_windows(a, b, x, y, shift_x, shift_y, size: int, reach: int, workers: int = 1):
    """Displacement of windows of `size` px around the pixels (x, y), by FFT, about a whole-pixel predictor.

    a, b: float32 images with zero where nothing is to be seen. Returns a dict of float32 arrays like x:
    dx, dy (px, image axes), second_x, second_y (second peak, whole px), ratio (first to second peak) and
    height (correlation coefficient of the first peak).
    """
    sx, sy = np.rint(shift_x).astype(np.int64), np.rint(shift_y).astype(np.int64)
    # the shift is split between the frames so that the vector belongs to (x, y), to half a pixel
    ax, ay = x - sx // 2, y - sy // 2
    bx, by = ax + sx, ay + sy
    n = x.size
    result = {
        k: np.empty(n, np.float32) for k in ("dx", "dy", "second_x", "second_y", "ratio", "height")
    }
    batch = max(1, 2_000_000 // (size * size))
    wa = np.empty((min(batch, n), size, size), np.float32)
    wb = np.empty_like(wa)
    for start in range(0, n, batch):
        part = slice(start, min(start + batch, n))
        m = part.stop - part.start
        _cut(a, ax[part], ay[part], size, wa[:m])
        _cut(b, bx[part], by[part], size, wb[:m])
        energy = np.sqrt(np.einsum("kij,kij->k", wa[:m], wa[:m]) * np.einsum("kij,kij->k", wb[:m], wb[:m]))
        fa = scipy.fft.rfft2(wa[:m], workers=workers)
        fb = scipy.fft.rfft2(wb[:m], workers=workers)
        np.conjugate(fa, out=fa)
        fa *= fb
        maps = scipy.fft.irfft2(fa, s=(size, size), workers=workers)
        _peaks(
            maps, reach, result["dx"][part], result["dy"][part],
            result["second_x"][part], result["second_y"][part], result["ratio"][part], result["height"][part],
        )  # fmt: skip
        result["height"][part] /= np.maximum(energy, 1e-20)
    result["dx"] += sx
    result["dy"] += sy
    result["second_x"] += sx
    result["second_y"] += sy
    return result
