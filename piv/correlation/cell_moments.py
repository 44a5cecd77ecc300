"""Products of two warped images and their gradients, summed over cells of 4 x 4 px."""

from __future__ import annotations

import numpy as np
from numpy import float32

from piv.compiled import fast, inlined

CELL = 4  # px: products are summed over cells before the window's weight is applied
BLOCK = 512  # px: columns whose sums over four rows stay in the first cache
MOMENTS = 9  # gx, gy, hxx, hxy, hyy, aa, bb, ab, weight
NEAR, FAR, HALF = (float32(8 / 12), float32(1 / 12), float32(0.5))  # of the fourth-order difference


@inlined
def _products(w, a, left_a, right_a, up_a, down_a, b, left_b, right_b, up_b, down_b):
    """MOMENTS of a pixel of weight w; neighbours: (next, next but one); gx, gy and hxy twice."""
    ax = NEAR * (right_a[0] - left_a[0]) - FAR * (right_a[1] - left_a[1])
    bx = NEAR * (right_b[0] - left_b[0]) - FAR * (right_b[1] - left_b[1])
    ay = NEAR * (down_a[0] - up_a[0]) - FAR * (down_a[1] - up_a[1])
    by = NEAR * (down_b[0] - up_b[0]) - FAR * (down_b[1] - up_b[1])
    wa, wb, wbx, wby = w * a, w * b, w * bx, w * by
    return (
        wa * bx - wb * ax, wa * by - wb * ay, ax * wbx, ax * wby + ay * wbx, ay * wby,
        wa * a, wb * b, wa * b, w,
    )  # fmt: skip


@inlined
def _row_products(w, i, a0, a1, a2, a3, a4, b0, b1, b2, b3, b4):
    """`_products` at pixel i of the middle of five rows, which begin two columns before."""
    k = i + 2
    return _products(
        w[i],
        a2[k], (a2[i + 1], a2[i]), (a2[i + 3], a2[i + 4]), (a1[k], a0[k]), (a3[k], a4[k]),
        b2[k], (b2[i + 1], b2[i]), (b2[i + 3], b2[i + 4]), (b1[k], b0[k]), (b3[k], b4[k]),
    )  # fmt: skip


@fast
def _four_rows(
    a0, a1, a2, a3, a4, a5, a6, a7, b0, b1, b2, b3, b4, b5, b6, b7, w0, w1, w2, w3, sums
):
    """Moments of every column over the middle four of eight rows: sums[m * BLOCK + column]."""
    for i in range(w0.size):
        p = _row_products(w0, i, a0, a1, a2, a3, a4, b0, b1, b2, b3, b4)
        q = _row_products(w1, i, a1, a2, a3, a4, a5, b1, b2, b3, b4, b5)
        r = _row_products(w2, i, a2, a3, a4, a5, a6, b2, b3, b4, b5, b6)
        s = _row_products(w3, i, a3, a4, a5, a6, a7, b3, b4, b5, b6, b7)
        sums[i] = HALF * (p[0] + q[0] + r[0] + s[0])
        sums[i + BLOCK] = HALF * (p[1] + q[1] + r[1] + s[1])
        sums[i + 2 * BLOCK] = p[2] + q[2] + r[2] + s[2]
        sums[i + 3 * BLOCK] = HALF * (p[3] + q[3] + r[3] + s[3])
        sums[i + 4 * BLOCK] = p[4] + q[4] + r[4] + s[4]
        sums[i + 5 * BLOCK] = p[5] + q[5] + r[5] + s[5]
        sums[i + 6 * BLOCK] = p[6] + q[6] + r[6] + s[6]
        sums[i + 7 * BLOCK] = p[7] + q[7] + r[7] + s[7]
        sums[i + 8 * BLOCK] = p[8] + q[8] + r[8] + s[8]


@fast
def _along(sums, out):
    """Sums over CELL columns."""
    for i in range(out.size):
        k = i * CELL
        out[i] = sums[k] + sums[k + 1] + sums[k + 2] + sums[k + 3]


@fast
def cell_row(a, b, weight, j, first, last, at, rows, columns, sums, out):
    """Cells `first` to `last` of row j of images of (rows, columns) px: out[:, j] (cell_moments).

    at: rows of a, b, weight with the eight rows from two above the cells to two below; sums: work.
    """
    none = np.zeros(columns, float32)
    for left in range(first * CELL, last * CELL, BLOCK):
        width = min(BLOCK, last * CELL - left)
        c0, c1 = (
            max(left, 2),
            min(left + width, columns - 2),
        )  # nearer the edge derivatives are not known
        for m in range(MOMENTS):
            sums[m * BLOCK : m * BLOCK + c0 - left] = 0
            sums[m * BLOCK + c1 - left : m * BLOCK + width] = 0
        s = slice(c0 - 2, c1 + 2)
        w0, w1, w2, w3 = none[c0:c1], none[c0:c1], none[c0:c1], none[c0:c1]
        if 2 <= CELL * j < rows - 2:
            w0 = weight[at[2], c0:c1]
        if 2 <= CELL * j + 1 < rows - 2:
            w1 = weight[at[3], c0:c1]
        if CELL * j + 2 < rows - 2:
            w2 = weight[at[4], c0:c1]
        if CELL * j + 3 < rows - 2:
            w3 = weight[at[5], c0:c1]
        _four_rows(
            a[at[0], s], a[at[1], s], a[at[2], s], a[at[3], s],
            a[at[4], s], a[at[5], s], a[at[6], s], a[at[7], s],
            b[at[0], s], b[at[1], s], b[at[2], s], b[at[3], s],
            b[at[4], s], b[at[5], s], b[at[6], s], b[at[7], s],
            w0, w1, w2, w3, sums[c0 - left :],
        )  # fmt: skip
        for m in range(MOMENTS):
            _along(sums[m * BLOCK :], out[m, j, left // CELL : (left + width) // CELL])


@fast
def cell_moments(a, b, weight, out):
    """Sums over CELL x CELL px of the correlation's gradient, cross-gradient Hessian and energies.

    a, b, weight: (rows, columns) float32 of the warped images. out: (MOMENTS, rows // CELL, columns
    // CELL). gx = Σ (a·∂b - b·∂a)/2 and hxy = Σ (∂xa·∂yb + ∂ya·∂xb)/2: products of one image with
    the other only, so that camera noise, independent in the two, leaves both unbiased.
    """
    rows, columns = a.shape
    sums = np.empty(MOMENTS * BLOCK, float32)
    at = np.empty(8, np.int64)
    for j in range(out.shape[1]):
        for k in range(8):
            at[k] = min(max(CELL * j - 2 + k, 0), rows - 1)
        cell_row(a, b, weight, j, 0, out.shape[2], at, rows, columns, sums, out)
