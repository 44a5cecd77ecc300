"""Products of two images warped half-way towards each other, computed a few rows at a time.

The displacement of a row, both warped images there and the products of four rows stay in a core's
cache. The images move by equal and opposite displacements, so that one has the sampling weights of
the other in reverse order.
"""

from __future__ import annotations

import numpy as np
from numpy import float32

from piv.compiled import compiled, fast
from piv.correlation.cell_moments import BLOCK, CELL, MOMENTS, cell_row
from piv.correlation.interpolate import LANES, PAD, row_sample, run_end, snapped, spline_row, taps

ROWS = 8  # kept of the warped images: those of a row of cells and two on either side
SHORT = 6  # px: of shorter runs each pixel is sampled by itself, as a run costs as much as so many
MARGIN = PAD - 3  # px: farther outside the image no sample is taken


@fast
def _split(w, x0, x1, x2, x3, y0, y1, y2, y3, reach_x, reach_y, stride, offset, frac_x, frac_y):
    """Whole-pixel offset in a flat image and fractions of a row's displacement, a B-spline."""
    w0, w1, w2, w3 = w[0], w[1], w[2], w[3]
    for i in range(reach_x.size):
        x = w0 * x0[i] + w1 * x1[i] + w2 * x2[i] + w3 * x3[i]
        y = w0 * y0[i] + w1 * y1[i] + w2 * y2[i] + w3 * y3[i]
        x = min(max(x, -reach_x[i]), reach_x[i])
        y = min(max(y, -reach_y), reach_y)
        whole_x, part_x = snapped(x)
        whole_y, part_y = snapped(y)
        frac_x[i], frac_y[i] = part_x, part_y
        offset[i] = np.int32(whole_y) * stride + np.int32(whole_x)


@fast
def _sample_run(a, p, b, q, stride, frac_x, frac_y, c, n, out_a, out_b):
    """Samples of both flat images at n pixels of one offset from `c` on; p, q: upper left ones.

    Unsigned indices are not tested for being negative; slices would cost as much as ten pixels.
    """
    p0, p1 = p, p + stride
    p2, p3 = p1 + stride, p1 + stride + stride
    q0, q1 = q, q + stride
    q2, q3 = q1 + stride, q1 + stride + stride
    for j in range(n):
        i = np.uint64(j)
        x0, x1, x2, x3 = taps(frac_x[c + i])
        y0, y1, y2, y3 = taps(frac_y[c + i])
        out_a[c + i] = (
            y0 * row_sample(a, p0 + i, x0, x1, x2, x3)
            + y1 * row_sample(a, p1 + i, x0, x1, x2, x3)
            + y2 * row_sample(a, p2 + i, x0, x1, x2, x3)
            + y3 * row_sample(a, p3 + i, x0, x1, x2, x3)
        )
        out_b[c + i] = (
            y3 * row_sample(b, q0 + i, x3, x2, x1, x0)
            + y2 * row_sample(b, q1 + i, x3, x2, x1, x0)
            + y1 * row_sample(b, q2 + i, x3, x2, x1, x0)
            + y0 * row_sample(b, q3 + i, x3, x2, x1, x0)
        )


@fast
def _weigh(usable_a, p, usable_b, q, c, n, weight):
    """Whether both samples of such a run may be used, as 1 or 0."""
    for j in range(n):
        i = np.uint64(j)
        weight[c + i] = float32(usable_a[p + i] & usable_b[q + i])


@fast
def _sample_each(
    a, b, usable_a, usable_b, first, stride, offset, frac_x, frac_y, c, end, out_a, out_b, weight
):
    """Samples of both flat images and their weight at the pixels `c` to `end`, one by one."""
    s, one, two = np.uint64(stride), np.uint64(1), np.uint64(2)
    for i in range(c, end):
        x0, x1, x2, x3 = taps(frac_x[i])
        y0, y1, y2, y3 = taps(frac_y[i])
        p0 = np.uint64(first + i + offset[i] - stride - 1)
        q0 = np.uint64(first + i - offset[i] - 2 * stride - 2)
        p1 = p0 + s
        p2 = p1 + s
        p3 = p2 + s
        q1 = q0 + s
        q2 = q1 + s
        q3 = q2 + s
        out_a[i] = (
            y0 * row_sample(a, p0, x0, x1, x2, x3)
            + y1 * row_sample(a, p1, x0, x1, x2, x3)
            + y2 * row_sample(a, p2, x0, x1, x2, x3)
            + y3 * row_sample(a, p3, x0, x1, x2, x3)
        )
        out_b[i] = (
            y3 * row_sample(b, q0, x3, x2, x1, x0)
            + y2 * row_sample(b, q1, x3, x2, x1, x0)
            + y1 * row_sample(b, q2, x3, x2, x1, x0)
            + y0 * row_sample(b, q3, x3, x2, x1, x0)
        )
        weight[i] = float32(usable_a[p1 + one] & usable_b[q2 + two])


@fast
def _warp_row(
    first, stride, a, b, usable_a, usable_b, offset, frac_x, frac_y, out_a, out_b, weight
):
    """Both flat images along a row from pixel `first` on; outputs are LANES longer than the row."""
    c = 0
    while c < offset.size:
        end = run_end(offset, c)
        if end - c < SHORT:
            _sample_each(
                a,
                b,
                usable_a,
                usable_b,
                first,
                stride,
                offset,
                frac_x,
                frac_y,
                c,
                end,
                out_a,
                out_b,
                weight,
            )
            c = end
            continue
        # pixels written beyond the run are overwritten by the next one
        n = (end - c + LANES - 1) // LANES * LANES
        p = first + c + offset[c] - stride - 1
        q = first + c - offset[c] - 2 * stride - 2
        at = np.uint64(c)
        _sample_run(
            a, np.uint64(p), b, np.uint64(q), np.uint64(stride), frac_x, frac_y, at, n, out_a, out_b
        )
        # the second image moves the other way, so its pixel is the next one
        p, q = p + stride + 1, q + 2 * stride + 2
        _weigh(usable_a, np.uint64(p), usable_b, np.uint64(q), at, n, weight)
        c = end


@compiled
def _runs(row, out):
    """Number of runs of non-zero values; out[k]: first of run k, and one past its last."""
    count = 0
    for i in range(row.size):
        if row[i] and (i == 0 or not row[i - 1]):
            out[count, 0] = i
            count += 1
        if row[i]:
            out[count - 1, 1] = i + 1
    return count


@fast
def pair_moments(
    a, usable_a, b, usable_b, knots_x, knots_y, first_y, weights_y, first_x, weights_x,
    wanted, around, out,
):  # fmt: skip
    """Products (cell_moments.cell_moments) of `a` moved by the knots' B-spline and `b` against it.

    a, b: images padded by PAD px, float32; usable: the same shape, uint8, 0 where masked; knots
    (ny+4, nx+4) with the tables of interpolate.bspline_table for every row and column; wanted:
    cells (uint8) to measure, around: these and those next to them; out: (MOMENTS, cells), not
    written where not wanted.
    """
    stride = a.shape[1]
    rows, columns = a.shape[0] - 2 * PAD, stride - 2 * PAD
    flat_a, flat_b = a.reshape(-1), b.reshape(-1)
    flat_usable_a, flat_usable_b = usable_a.reshape(-1), usable_b.reshape(-1)
    # rows outside the image are never written: they must be finite, as their weight is zero
    wide = (ROWS, columns + LANES)
    warped_a, warped_b = np.zeros(wide, float32), np.zeros(wide, float32)
    weight = np.zeros(wide, float32)
    along_x, along_y = np.empty((4, columns), float32), np.empty((4, columns), float32)
    frac_x, frac_y = np.zeros(columns + LANES, float32), np.zeros(columns + LANES, float32)
    offset = np.empty(columns, np.int32)
    reach_x = np.empty(columns, float32)
    for i in range(columns):
        reach_x[i] = min(i, columns - 1 - i) + MARGIN
    sums = np.empty(MOMENTS * BLOCK, float32)
    at = np.empty(ROWS, np.int64)
    w = np.empty(4, float32)
    knot, done = first_y[0], 0
    runs = np.empty((out.shape[2] // 2 + 1, 2), np.int64)
    for j in range(out.shape[1]):
        count = _runs(around[j], runs)
        for r in range(done, min(CELL * (j + 1) + 2, rows)):
            while knot < first_y[r] + 4:
                spline_row(knots_x[knot], first_x, weights_x, along_x[knot % 4])
                spline_row(knots_y[knot], first_x, weights_x, along_y[knot % 4])
                knot += 1
            k = first_y[r]
            k0, k1, k2, k3 = k % 4, (k + 1) % 4, (k + 2) % 4, (k + 3) % 4
            w[:] = weights_y[:, r]
            reach_y = float32(min(r, rows - 1 - r) + MARGIN)
            for run in range(count):
                first, last = CELL * runs[run, 0], CELL * runs[run, 1]
                last = columns if last > columns - CELL else last
                s = slice(first, last)
                _split(
                    w, along_x[k0, s], along_x[k1, s], along_x[k2, s], along_x[k3, s],
                    along_y[k0, s], along_y[k1, s], along_y[k2, s], along_y[k3, s],
                    reach_x[s], reach_y, np.int32(stride), offset[s], frac_x[s], frac_y[s],
                )  # fmt: skip
                s = slice(first, last + LANES)
                _warp_row(
                    (r + PAD) * stride + PAD + first, stride,
                    flat_a, flat_b, flat_usable_a, flat_usable_b,
                    offset[first:last], frac_x[s], frac_y[s],
                    warped_a[r % ROWS, s], warped_b[r % ROWS, s], weight[r % ROWS, s],
                )  # fmt: skip
            done = r + 1
        for k in range(ROWS):
            at[k] = (CELL * j - 2 + k) % ROWS
        for run in range(_runs(wanted[j], runs)):
            cell_row(
                warped_a, warped_b, weight, j, runs[run, 0], runs[run, 1], at, rows, columns,
                sums, out,
            )  # fmt: skip
