"""Products of two images warped half-way towards each other, made a few rows at a time in a core's cache.

The displacement of a row of pixels, both images there and the products of four rows at a time never reach main
memory. The images move by as much in opposite directions, so that one has the other's sampling weights backwards.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from piv.interpolate import LANES, PAD, run_end, spline_row, taps
from piv.refine import BLOCK, CELL, MOMENTS, cell_row

ROWS = 8  # held of the warped images: those of a row of cells and two on either side
MARGIN = PAD - 3  # px: farther outside the image no sample is taken


@njit(cache=True, nogil=True, fastmath=True)
def _split(w, x0, x1, x2, x3, y0, y1, y2, y3, reach_x, reach_y, stride, offset, frac_x, frac_y):
    """Whole-pixel offset (in a flat image) and fractions of a row's displacement, a B-spline of four rows with weights `w`."""
    w0, w1, w2, w3 = w[0], w[1], w[2], w[3]
    for i in range(reach_x.size):
        x = w0 * x0[i] + w1 * x1[i] + w2 * x2[i] + w3 * x3[i]
        y = w0 * y0[i] + w1 * y1[i] + w2 * y2[i] + w3 * y3[i]
        x = min(max(x, -reach_x[i]), reach_x[i])
        y = min(max(y, -reach_y), reach_y)
        whole_x, whole_y = np.floor(x), np.floor(y)
        frac_x[i] = x - whole_x
        frac_y[i] = y - whole_y
        offset[i] = np.int32(whole_y) * stride + np.int32(whole_x)


@njit(cache=True, nogil=True, fastmath=True)
def _sample_run(a0, a1, a2, a3, b0, b1, b2, b3, frac_x, frac_y, out_a, out_b):
    """Samples of both images at a run of pixels with one whole-pixel offset, from four rows of each."""
    for i in range(out_a.size):
        x0, x1, x2, x3 = taps(frac_x[i])
        y0, y1, y2, y3 = taps(frac_y[i])
        out_a[i] = (
            y0 * (x0 * a0[i] + x1 * a0[i + 1] + x2 * a0[i + 2] + x3 * a0[i + 3])
            + y1 * (x0 * a1[i] + x1 * a1[i + 1] + x2 * a1[i + 2] + x3 * a1[i + 3])
            + y2 * (x0 * a2[i] + x1 * a2[i + 1] + x2 * a2[i + 2] + x3 * a2[i + 3])
            + y3 * (x0 * a3[i] + x1 * a3[i + 1] + x2 * a3[i + 2] + x3 * a3[i + 3])
        )
        out_b[i] = (
            y3 * (x3 * b0[i] + x2 * b0[i + 1] + x1 * b0[i + 2] + x0 * b0[i + 3])
            + y2 * (x3 * b1[i] + x2 * b1[i + 1] + x1 * b1[i + 2] + x0 * b1[i + 3])
            + y1 * (x3 * b2[i] + x2 * b2[i + 1] + x1 * b2[i + 2] + x0 * b2[i + 3])
            + y0 * (x3 * b3[i] + x2 * b3[i + 1] + x1 * b3[i + 2] + x0 * b3[i + 3])
        )


@njit(cache=True, nogil=True, fastmath=True)
def _weigh(usable_a, usable_b, weight):
    """Whether both samples of a run may be used, as 1 or 0."""
    for i in range(weight.size):
        weight[i] = np.float32(usable_a[i] & usable_b[i])


@njit(cache=True, nogil=True, fastmath=True)
def _warp_row(first, stride, a, b, usable_a, usable_b, offset, frac_x, frac_y, out_a, out_b, weight):
    """Both images (flat) along one row, whose first pixel is the `first`-th; the outputs are LANES longer than the row."""
    c = 0
    while c < offset.size:
        end = run_end(offset, c)
        # what is written beyond the run is written again with the next one
        n = (end - c + LANES - 1) // LANES * LANES
        p = first + c + offset[c] - stride - 1
        q = first + c - offset[c] - 2 * stride - 2
        _sample_run(
            a[p : p + n + 3], a[p + stride : p + stride + n + 3],
            a[p + 2 * stride : p + 2 * stride + n + 3], a[p + 3 * stride : p + 3 * stride + n + 3],
            b[q : q + n + 3], b[q + stride : q + stride + n + 3],
            b[q + 2 * stride : q + 2 * stride + n + 3], b[q + 3 * stride : q + 3 * stride + n + 3],
            frac_x[c : c + n], frac_y[c : c + n], out_a[c : c + n], out_b[c : c + n],
        )  # fmt: skip
        p, q = p + stride + 1, q + stride + 1
        _weigh(usable_a[p : p + n], usable_b[q : q + n], weight[c : c + n])
        c = end


@njit(cache=True, nogil=True, fastmath=True)
def pair_moments(a, usable_a, b, usable_b, knots_x, knots_y, first_y, weights_y, first_x, weights_x, out):
    """Products of image `a` moved by the B-spline of the knots and `b` moved against it: see refine.cell_moments.

    a, b: images padded by PAD px, float32; usable: the same shape, uint8, 0 where they must take no part; knots
    (ny+4, nx+4) with the tables of interpolate.bspline_table for every row and column; out: (MOMENTS, cells).
    """
    stride = a.shape[1]
    rows, columns = a.shape[0] - 2 * PAD, stride - 2 * PAD
    flat_a, flat_b = a.reshape(-1), b.reshape(-1)
    flat_usable_a, flat_usable_b = usable_a.reshape(-1), usable_b.reshape(-1)
    # rows outside the image are never written: they must be finite, as their weight is zero
    wide = (ROWS, columns + LANES)
    warped_a, warped_b = np.zeros(wide, np.float32), np.zeros(wide, np.float32)
    weight = np.zeros(wide, np.float32)
    along_x, along_y = np.empty((4, columns), np.float32), np.empty((4, columns), np.float32)
    frac_x, frac_y = np.zeros(columns + LANES, np.float32), np.zeros(columns + LANES, np.float32)
    offset = np.empty(columns, np.int32)
    reach_x = np.empty(columns, np.float32)
    for i in range(columns):
        reach_x[i] = min(i, columns - 1 - i) + MARGIN
    sums = np.empty(MOMENTS * BLOCK, np.float32)
    held = np.empty(ROWS, np.int64)
    w = np.empty(4, np.float32)
    knot, done = first_y[0], 0
    for j in range(out.shape[1]):
        for r in range(done, min(CELL * (j + 1) + 2, rows)):
            while knot < first_y[r] + 4:
                spline_row(knots_x[knot], first_x, weights_x, along_x[knot % 4])
                spline_row(knots_y[knot], first_x, weights_x, along_y[knot % 4])
                knot += 1
            k = first_y[r]
            k0, k1, k2, k3 = k % 4, (k + 1) % 4, (k + 2) % 4, (k + 3) % 4
            w[:] = weights_y[:, r]
            _split(
                w, along_x[k0], along_x[k1], along_x[k2], along_x[k3],
                along_y[k0], along_y[k1], along_y[k2], along_y[k3],
                reach_x, np.float32(min(r, rows - 1 - r) + MARGIN), np.int32(stride), offset, frac_x, frac_y,
            )  # fmt: skip
            _warp_row(
                (r + PAD) * stride + PAD, stride, flat_a, flat_b, flat_usable_a, flat_usable_b,
                offset, frac_x, frac_y, warped_a[r % ROWS], warped_b[r % ROWS], weight[r % ROWS],
            )  # fmt: skip
            done = r + 1
        for k in range(ROWS):
            held[k] = (CELL * j - 2 + k) % ROWS
        cell_row(warped_a, warped_b, weight, j, held, rows, columns, sums, out)
