"""Cubic B-spline image warping by a displacement known on a regular grid of vectors."""

from __future__ import annotations

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
def _blend(k0, k1, k2, k3, weights, out):
    for i in range(out.size):
        out[i] = k0 * weights[0, i] + k1 * weights[1, i] + k2 * weights[2, i] + k3 * weights[3, i]


@njit(cache=True, nogil=True, fastmath=True)
def _blend_rows(weights, r0, r1, r2, r3, out):
    for i in range(out.size):
        out[i] = weights[0] * r0[i] + weights[1] * r1[i] + weights[2] * r2[i] + weights[3] * r3[i]


@njit(cache=True, nogil=True, fastmath=True)
def dense_field(knots, first_y, weights_y, first_x, weights_x, out):
    """Evaluate a padded grid of spline coefficients (ny+4, nx+4) on every pixel: out (rows, columns)."""
    rows, columns = out.shape
    line = np.empty(knots.shape[1], np.float32)
    w = np.empty(4, np.float32)
    for r in range(rows):
        j = first_y[r]
        w[:] = weights_y[:, r]
        _blend_rows(w, knots[j], knots[j + 1], knots[j + 2], knots[j + 3], line)
        c = 0
        while c < columns:
            i = first_x[c]
            end = c + 1
            while end < columns and first_x[end] == i:
                end += 1
            _blend(line[i], line[i + 1], line[i + 2], line[i + 3], weights_x[:, c:end], out[r, c:end])
            c = end


@njit(cache=True, nogil=True, fastmath=True, inline="always")
def _cubic(t):
    """Cubic B-spline weights at the fraction t between two samples."""
    sixth = np.float32(1 / 6)
    s = np.float32(1) - t
    first = s * s * s * sixth
    last = t * t * t * sixth
    second = np.float32(2 / 3) + t * t * (np.float32(0.5) * t - np.float32(1))
    return first, second, np.float32(1) - first - second - last, last


@njit(cache=True, nogil=True, fastmath=True)
def _sample_run(p0, p1, p2, p3, frac_x, frac_y, out):
    """Samples of a run of pixels with one whole-pixel shift: contiguous, so that the loop vectorises."""
    for i in range(out.size):
        a0, a1, a2, a3 = _cubic(frac_x[i])
        b0, b1, b2, b3 = _cubic(frac_y[i])
        out[i] = (
            b0 * (a0 * p0[i] + a1 * p0[i + 1] + a2 * p0[i + 2] + a3 * p0[i + 3])
            + b1 * (a0 * p1[i] + a1 * p1[i + 1] + a2 * p1[i + 2] + a3 * p1[i + 3])
            + b2 * (a0 * p2[i] + a1 * p2[i + 1] + a2 * p2[i + 2] + a3 * p2[i + 3])
            + b3 * (a0 * p3[i] + a1 * p3[i + 1] + a2 * p3[i + 2] + a3 * p3[i + 3])
        )


@njit(cache=True, nogil=True, fastmath=True)
def _split(shift, start, low, high, base, frac):
    """Whole-pixel shift and fraction of the sampling positions start + i + shift[i], kept within limits."""
    for i in range(shift.size):
        p = min(max(start[i] + shift[i], low), high)
        whole = np.floor(p)
        frac[i] = p - whole
        base[i] = np.int32(whole - start[i])


@njit(cache=True, nogil=True, fastmath=True)
def warp(coefficients, usable, dx, dy, factor, out, weight, multiply):
    """Sample a cubic spline at (x + factor·dx, y + factor·dy) for every pixel of `out`.

    coefficients: (rows+2·PAD, columns+2·PAD) float32; usable: the same shape, float32, 0 where the image must
    take no part. weight (rows, columns) float32 is set to (or, with `multiply`, multiplied by) `usable` there.
    """
    rows, columns = out.shape
    base_x = np.empty(columns, np.int32)
    base_y = np.empty(columns, np.int32)
    frac_x = np.empty(columns, np.float32)
    frac_y = np.empty(columns, np.float32)
    shift_x = np.empty(columns, np.float32)
    shift_y = np.empty(columns, np.float32)
    start_x = np.arange(columns).astype(np.float32)
    start_y = np.empty(columns, np.float32)
    low = np.float32(1 - PAD)
    high_x = np.float32(columns + PAD - 3.01)
    high_y = np.float32(rows + PAD - 3.01)
    f = np.float32(factor)
    for r in range(rows):
        shift_x[:] = f * dx[r]
        shift_y[:] = f * dy[r]
        start_y[:] = np.float32(r)
        _split(shift_x, start_x, low, high_x, base_x, frac_x)
        _split(shift_y, start_y, low, high_y, base_y, frac_y)
        c = 0
        while c < columns:
            bx, by = base_x[c], base_y[c]
            end = c + 1
            while end < columns and base_x[end] == bx and base_y[end] == by:
                end += 1
            top = r + by + PAD - 1
            k = c + bx + PAD - 1
            n = end - c
            _sample_run(
                coefficients[top, k : k + n + 3], coefficients[top + 1, k : k + n + 3],
                coefficients[top + 2, k : k + n + 3], coefficients[top + 3, k : k + n + 3],
                frac_x[c:end], frac_y[c:end], out[r, c:end],
            )  # fmt: skip
            if multiply:
                weight[r, c:end] *= usable[top + 1, k + 1 : k + 1 + n]
            else:
                weight[r, c:end] = usable[top + 1, k + 1 : k + 1 + n]
            c = end
