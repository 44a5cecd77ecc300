"""Cubic B-spline image warping by a displacement known on a regular grid of vectors."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

PAD = 16  # px of border around spline coefficients: samples further outside are not taken


def bspline_table(positions: np.ndarray, origin: float, spacing: float, count: int) -> tuple:
    """Cubic B-spline weights of `count` regular knots at the given positions.

    Returns (first, weights): knots first[i] … first[i]+3 (of the knots padded by 2 on either side) carry
    weights[:, i] at positions[i].
    """
    s = np.clip((np.asarray(positions, float) - origin) / spacing, -0.999, count - 0.001)
    base = np.floor(s)
    t = s - base
    weights = np.stack([(1 - t) ** 3, 4 - 6 * t**2 + 3 * t**3, 1 + 3 * t + 3 * t**2 - 3 * t**3, t**3]) / 6
    return base.astype(np.int64) + 1, weights.astype(np.float32)


@njit(cache=True, nogil=True, fastmath=True)
def dense_field(knots, first_y, weights_y, first_x, weights_x, out):
    """Evaluate a padded grid of spline coefficients (ny+4, nx+4) on every pixel: out (rows, columns)."""
    rows, columns = out.shape
    nx = knots.shape[1]
    line = np.empty(nx, np.float32)
    for r in range(rows):
        j = first_y[r]
        w0, w1, w2, w3 = weights_y[0, r], weights_y[1, r], weights_y[2, r], weights_y[3, r]
        for i in range(nx):
            line[i] = w0 * knots[j, i] + w1 * knots[j + 1, i] + w2 * knots[j + 2, i] + w3 * knots[j + 3, i]
        c = 0
        while c < columns:
            i = first_x[c]
            end = c + 1
            while end < columns and first_x[end] == i:
                end += 1
            k0, k1, k2, k3 = line[i], line[i + 1], line[i + 2], line[i + 3]
            for x in range(c, end):
                out[r, x] = (
                    k0 * weights_x[0, x] + k1 * weights_x[1, x] + k2 * weights_x[2, x] + k3 * weights_x[3, x]
                )
            c = end


@njit(cache=True, nogil=True, fastmath=True)
def warp(coefficients, usable, dx, dy, factor, out, weight, multiply):
    """Sample a cubic spline at (x + factor·dx, y + factor·dy) for every pixel of `out`.

    coefficients: (rows+2·PAD, columns+2·PAD) float32; usable: the same shape, uint8, 0 where the image must
    take no part. weight (rows, columns) float32 is set to (or, with `multiply`, multiplied by) `usable` there.
    Runs of pixels that share the same whole-pixel shift are contiguous in memory, so that they vectorise.
    """
    rows, columns = out.shape
    low = np.float32(1 - PAD)
    high_x = np.float32(columns + PAD - 3.001)
    high_y = np.float32(rows + PAD - 3.001)
    base_x = np.empty(columns, np.int32)
    base_y = np.empty(columns, np.int32)
    frac_x = np.empty(columns, np.float32)
    frac_y = np.empty(columns, np.float32)
    f = np.float32(factor)
    sixth = np.float32(1 / 6)
    one = np.float32(1)
    three = np.float32(3)
    four = np.float32(4)
    six = np.float32(6)
    for r in range(rows):
        for c in range(columns):
            px = min(max(np.float32(c) + f * dx[r, c], low), high_x)
            py = min(max(np.float32(r) + f * dy[r, c], low), high_y)
            ix = math.floor(px)
            iy = math.floor(py)
            frac_x[c] = px - np.float32(ix)
            frac_y[c] = py - np.float32(iy)
            base_x[c] = np.int32(ix) - c
            base_y[c] = np.int32(iy)
        c = 0
        while c < columns:
            ox = base_x[c]
            y0 = base_y[c]
            end = c + 1
            while end < columns and base_x[end] == ox and base_y[end] == y0:
                end += 1
            start = ox + PAD - 1
            top = y0 + PAD - 1
            for x in range(c, end):
                t = frac_x[x]
                s = one - t
                a0 = s * s * s * sixth
                a3 = t * t * t * sixth
                a1 = (four + t * t * (three * t - six)) * sixth
                a2 = one - a0 - a1 - a3
                t = frac_y[x]
                s = one - t
                b0 = s * s * s * sixth
                b3 = t * t * t * sixth
                b1 = (four + t * t * (three * t - six)) * sixth
                b2 = one - b0 - b1 - b3
                k = x + start
                p = a0 * coefficients[top, k] + a1 * coefficients[top, k + 1]
                p += a2 * coefficients[top, k + 2] + a3 * coefficients[top, k + 3]
                value = b0 * p
                p = a0 * coefficients[top + 1, k] + a1 * coefficients[top + 1, k + 1]
                p += a2 * coefficients[top + 1, k + 2] + a3 * coefficients[top + 1, k + 3]
                value += b1 * p
                p = a0 * coefficients[top + 2, k] + a1 * coefficients[top + 2, k + 1]
                p += a2 * coefficients[top + 2, k + 2] + a3 * coefficients[top + 2, k + 3]
                value += b2 * p
                p = a0 * coefficients[top + 3, k] + a1 * coefficients[top + 3, k + 1]
                p += a2 * coefficients[top + 3, k + 2] + a3 * coefficients[top + 3, k + 3]
                out[r, x] = value + b3 * p
            if multiply:
                for x in range(c, end):
                    weight[r, x] *= np.float32(usable[top + 1, x + start + 1])
            else:
                for x in range(c, end):
                    weight[r, x] = np.float32(usable[top + 1, x + start + 1])
            c = end
