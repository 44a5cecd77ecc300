"""Newton steps on the windowed correlation of two images warped towards each other."""

from __future__ import annotations

import numpy as np
from numba import njit

CELL = 4  # px: products are summed over cells before the window's weight is applied
BLOCK = 256  # px
MOMENTS = 9  # gx, gy, hxx, hxy, hyy, aa, bb, ab, weight


@njit(cache=True, nogil=True, fastmath=True)
def _row_moments(a, above_a, a0, below_a, last_a, b, above_b, b0, below_b, last_b, weight, sums):
    """Add the products of one row to `sums`; the arguments are the rows r-2 … r+2 of both images."""
    p = np.float32(8 / 12)
    q = np.float32(1 / 12)
    half = np.float32(0.5)
    for i in range(weight.size):
        w = weight[i]
        va = a0[i + 2]
        vb = b0[i + 2]
        ax = p * (a0[i + 3] - a0[i + 1]) - q * (a0[i + 4] - a0[i])
        bx = p * (b0[i + 3] - b0[i + 1]) - q * (b0[i + 4] - b0[i])
        ay = p * (below_a[i + 2] - above_a[i + 2]) - q * (last_a[i + 2] - a[i + 2])
        by = p * (below_b[i + 2] - above_b[i + 2]) - q * (last_b[i + 2] - b[i + 2])
        wa = w * va
        wb = w * vb
        sums[0, i] += half * (wa * bx - wb * ax)
        sums[1, i] += half * (wa * by - wb * ay)
        sums[2, i] += w * ax * bx
        sums[3, i] += half * w * (ax * by + ay * bx)
        sums[4, i] += w * ay * by
        sums[5, i] += wa * va
        sums[6, i] += wb * vb
        sums[7, i] += wa * vb
        sums[8, i] += w


@njit(cache=True, nogil=True, fastmath=True)
def cell_moments(a, b, weight, out):
    """Sums over CELL x CELL px of the correlation's gradient, its cross-gradient Hessian and the energies.

    a, b, weight: (rows, columns) float32 of the warped images. out: (MOMENTS, rows // CELL, columns // CELL).
    gx = Σ (a·∂b - b·∂a)/2 and hxy = Σ (∂xa·∂yb + ∂ya·∂xb)/2: products of one image with the other only, so that
    camera noise, independent in the two, leaves both unbiased.
    """
    rows, columns = a.shape
    cells_y, cells_x = out.shape[1], out.shape[2]
    sums = np.empty((MOMENTS, BLOCK), np.float32)
    for left in range(0, cells_x * CELL, BLOCK):  # blocks of columns whose sums stay in the first cache
        width = min(BLOCK, cells_x * CELL - left)
        c0, c1 = max(left, 2), min(left + width, columns - 2)
        for j in range(cells_y):
            sums[:] = 0
            for r in range(max(j * CELL, 2), min((j + 1) * CELL, rows - 2)):
                s = slice(c0 - 2, c1 + 2)
                _row_moments(
                    a[r - 2, s], a[r - 1, s], a[r, s], a[r + 1, s], a[r + 2, s],
                    b[r - 2, s], b[r - 1, s], b[r, s], b[r + 1, s], b[r + 2, s],
                    weight[r, c0:c1], sums[:, c0 - left : c1 - left],
                )  # fmt: skip
            for m in range(MOMENTS):
                for i in range(width // CELL):
                    k = i * CELL
                    out[m, j, left // CELL + i] = (
                        sums[m, k] + sums[m, k + 1] + sums[m, k + 2] + sums[m, k + 3]
                    )


def window_weights(nodes: np.ndarray, cells: int, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Gaussian weights of the cells around each node: (first cell of each node, weights (node, cell))."""
    reach = int(np.ceil(3.0 * sigma / CELL)) + 1
    centre = (nodes - (CELL - 1) / 2) / CELL
    first = np.floor(centre).astype(np.int64) - reach
    k = first[:, None] + np.arange(2 * reach + 2)
    w = np.exp(-0.5 * ((k - centre[:, None]) * CELL / sigma) ** 2)
    w[(k < 0) | (k >= cells)] = 0
    return first, w.astype(np.float32)


@njit(cache=True, nogil=True, fastmath=True)
def _dot(a, b):
    total = np.float32(0)
    for k in range(a.size):
        total += a[k] * b[k]
    return total


@njit(cache=True, nogil=True, fastmath=True)
def _add(line, weight, row):
    for c in range(line.size):
        line[c] += weight * row[c]


@njit(cache=True, nogil=True, fastmath=True)
def window_sums(moments, first_y, weight_y, first_x, weight_x, out):
    """out[m, j, i] = Σ weight_y[j] weight_x[i] moments[m] around node (j, i)."""
    count, _, cells_x = moments.shape
    ny, ky = weight_y.shape
    nx, kx = weight_x.shape
    padded = np.zeros(cells_x + 2 * kx, np.float32)  # cells beyond the image count as zero
    line = padded[kx : kx + cells_x]
    for m in range(count):
        for j in range(ny):
            line[:] = 0
            for k in range(ky):
                if weight_y[j, k] != 0:
                    _add(line, weight_y[j, k], moments[m, first_y[j] + k])
            for i in range(nx):
                start = min(max(first_x[i] + kx, 0), cells_x + kx)
                out[m, j, i] = _dot(weight_x[i], padded[start : start + kx])


@njit(cache=True, nogil=True)
def _solve(sums, limit, step_x, step_y, correlation):
    ny, nx = step_x.shape
    for j in range(ny):
        for i in range(nx):
            step_x[j, i] = step_y[j, i] = correlation[j, i] = 0
            energy = np.sqrt(max(sums[5, j, i] * sums[6, j, i], np.float32(0)))
            if energy <= 0:
                continue
            gx, gy = sums[0, j, i], sums[1, j, i]
            correlation[j, i] = sums[7, j, i] / energy
            # a window without common texture has no curvature to trust: the floor keeps its step small
            floor = np.float32(0.025) * energy
            hxx = max(sums[2, j, i], floor)
            hyy = max(sums[4, j, i], floor)
            bound = np.float32(0.8) * np.sqrt(hxx * hyy)
            hxy = min(max(sums[3, j, i], -bound), bound)
            det = hxx * hyy - hxy * hxy
            if not det > 0:  # texture so faint that its square underflows
                continue
            sx = (hyy * gx - hxy * gy) / det
            sy = (hxx * gy - hxy * gx) / det
            length = np.sqrt(sx * sx + sy * sy)
            if length > limit:
                sx *= limit / length
                sy *= limit / length
            step_x[j, i] = sx
            step_y[j, i] = sy


def newton_step(sums: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Solve H d = g at every node: (step_x, step_y, correlation coefficient of the window).

    sums: (MOMENTS, ny, nx) window sums; steps longer than `limit` px are shortened; no texture, no step.
    """
    step_x, step_y, correlation = (np.empty(sums.shape[1:], np.float32) for _ in range(3))
    _solve(sums, np.float32(limit), step_x, step_y, correlation)
    return step_x, step_y, correlation
