"""Image warping by a displacement known on a regular grid of vectors.

Images are sampled with a Kaiser-Bessel kernel four pixels wide behind a matching prefilter: at the
cost of a cubic B-spline it leaks twenty times less of its spectrum's mirror image at 0.4 cycles/px,
which is what biases displacements of particle images of two to three pixels (peak locking).
"""

from __future__ import annotations

import numpy as np
from numpy import float32, ndarray

from piv.compiled import compiled, fast, inlined

BETA = 7.0  # of the Kaiser-Bessel kernel: leaks least over 0 … 0.42 cycles/px
PAD = 16  # px of border around spline coefficients: samples further outside are not taken
LANES = 16  # px: runs of pixels are rounded up to so many, the width of a core's vectors
# px: nearer to a whole pixel the sample is taken there, so that both images of a pair at rest agree
SNAP = float32(6e-5)
END = float32(1e6)  # per px: makes the outermost tap zero on a whole pixel only


def kernel_values(x: ndarray) -> ndarray:
    """Kaiser-Bessel kernel of unit area, zero beyond 2 px."""
    inside = np.maximum(1 - (np.asarray(x, float) / 2) ** 2, 0)
    area = 4 * np.sinh(BETA) / BETA
    return np.where(np.abs(x) <= 2, np.i0(BETA * np.sqrt(inside)), 0) / area


def kernel_response(frequency: ndarray) -> ndarray:
    """Fourier transform of the kernel at `frequency` (cycles/px, at most 0.5), 1 at zero."""
    root = np.sqrt(BETA**2 - (4 * np.pi * np.asarray(frequency, float)) ** 2)
    return np.sinh(root) / root * BETA / np.sinh(BETA)


def _polynomials() -> ndarray:
    """Outer and inner tap as polynomials of u = t - 1/2: even in u², odd in u·u² (rows)."""
    u = np.cos(np.linspace(0, np.pi, 201)) / 2
    rows = []
    for centre in (1.5, 0.5):
        right, left = kernel_values(centre + u), kernel_values(centre - u)
        for part, powers in (
            ((right + left) / 2, (0, 2, 4, 6)),
            ((right - left) / 2, (1, 3, 5, 7)),
        ):
            rows.append(np.linalg.lstsq(u[:, None] ** np.array(powers), part, rcond=None)[0])
    return np.array(rows)


_TAPS = tuple(float32(c) for c in _polynomials().ravel())


def bspline_table(positions: ndarray, origin: float, spacing: float, count: int) -> tuple:
    """Cubic B-spline weights of `count` regular knots at the given positions.

    Returns (first, weights): knots first[i] … first[i]+3 (of the knots padded by 2 on either side)
    carry weights[:, i] at positions[i].
    """
    s = np.clip((np.asarray(positions, float) - origin) / spacing, -0.999, count - 0.001)
    base = np.floor(s)
    t = s - base
    weights = (
        np.stack([(1 - t) ** 3, 4 - 6 * t**2 + 3 * t**3, 1 + 3 * t + 3 * t**2 - 3 * t**3, t**3]) / 6
    )
    return base.astype(np.int64) + 1, weights.astype(float32)


@fast
def _blend(k0, k1, k2, k3, weights, out):
    for i in range(out.size):
        out[i] = k0 * weights[0, i] + k1 * weights[1, i] + k2 * weights[2, i] + k3 * weights[3, i]


@fast
def spline_row(knots, first_x, weights_x, out):
    """One row of spline coefficients (nx+4) blended along x: `out` (columns)."""
    c = 0
    while c < out.size:
        i = first_x[c]
        end = c + 1
        while end < out.size and first_x[end] == i:
            end += 1
        _blend(knots[i], knots[i + 1], knots[i + 2], knots[i + 3], weights_x[:, c:end], out[c:end])
        c = end


@fast
def _blend_rows(weights, r0, r1, r2, r3, out):
    for i in range(out.size):
        out[i] = weights[0] * r0[i] + weights[1] * r1[i] + weights[2] * r2[i] + weights[3] * r3[i]


@fast
def dense_field(knots, first_y, weights_y, first_x, weights_x, out):
    """Evaluate padded spline coefficients (ny+4, nx+4) on every pixel: out (rows, columns)."""
    rows, columns = out.shape
    across = np.empty((knots.shape[0], columns), float32)
    for j in range(knots.shape[0]):
        spline_row(knots[j], first_x, weights_x, across[j])
    w = np.empty(4, float32)
    for r in range(rows):
        j = first_y[r]
        w[:] = weights_y[:, r]
        _blend_rows(w, across[j], across[j + 1], across[j + 2], across[j + 3], out[r])


@inlined
def taps(t):
    """Weights of the four samples round the fraction t; those of 1 - t are the same backwards."""
    u = t - float32(0.5)
    q = u * u
    even = _TAPS[0] + q * (_TAPS[1] + q * (_TAPS[2] + q * _TAPS[3]))
    odd = u * (_TAPS[4] + q * (_TAPS[5] + q * (_TAPS[6] + q * _TAPS[7])))
    inner_even = _TAPS[8] + q * (_TAPS[9] + q * (_TAPS[10] + q * _TAPS[11]))
    inner_odd = u * (_TAPS[12] + q * (_TAPS[13] + q * (_TAPS[14] + q * _TAPS[15])))
    # on a whole pixel both images of a pair have three taps, the same from either side
    first, last = min(even + odd, END * (float32(1) - t)), min(even - odd, END * t)
    return first, inner_even + inner_odd, inner_even - inner_odd, last


@inlined
def row_sample(row, k, w0, w1, w2, w3):
    """Weighted sum of four samples of a row from index `k` on."""
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    return w0 * row[k] + w1 * row[k + one] + w2 * row[k + two] + w3 * row[k + three]


@compiled
def run_end(offset, first):
    """One past the last of the pixels from `first` on that have one `offset`."""
    own, last = offset[first], offset.size
    end = first + 1
    while end + LANES <= last:
        differ = np.int32(0)
        for other in offset[end : end + LANES]:
            differ |= other ^ own
        if differ != 0:
            break
        end += LANES
    while end < last and offset[end] == own:
        end += 1
    return end


@fast
def _sample_run(p0, p1, p2, p3, frac_x, frac_y, out):
    """Samples of a run of pixels with one whole-pixel shift: contiguous, so it vectorises."""
    for i in range(out.size):
        a0, a1, a2, a3 = taps(frac_x[i])
        b0, b1, b2, b3 = taps(frac_y[i])
        out[i] = (
            b0 * (a0 * p0[i] + a1 * p0[i + 1] + a2 * p0[i + 2] + a3 * p0[i + 3])
            + b1 * (a0 * p1[i] + a1 * p1[i + 1] + a2 * p1[i + 2] + a3 * p1[i + 3])
            + b2 * (a0 * p2[i] + a1 * p2[i + 1] + a2 * p2[i + 2] + a3 * p2[i + 3])
            + b3 * (a0 * p3[i] + a1 * p3[i + 1] + a2 * p3[i + 2] + a3 * p3[i + 3])
        )


@inlined
def snapped(position):
    """Whole pixel below a position (px) and the fraction beyond it, zero where it is below SNAP."""
    whole = np.floor(position + SNAP)
    return whole, position - whole if position - whole > SNAP else float32(0)


@fast
def _split(
    factor, shift_x, shift_y, first_row, low, high_x, high_y, stride, offset, frac_x, frac_y
):
    """Whole-pixel offset in a flat image and fractions of positions moved by factor * shift."""
    y = float32(first_row)
    for i in range(shift_x.size):
        x = float32(i)
        px = min(max(factor * shift_x[i], low - x), high_x - x)
        py = min(max(factor * shift_y[i], low - y), high_y - y)
        whole_x, part_x = snapped(px)
        whole_y, part_y = snapped(py)
        frac_x[i], frac_y[i] = part_x, part_y
        offset[i] = np.int32(whole_y) * stride + np.int32(whole_x)


@fast
def warp(coefficients, usable, dx, dy, factor, first, out, weight, multiply):
    """Sample an image at (x + factor·dx, y + factor·dy) for the rows of `out` from `first` on.

    coefficients: the image padded by PAD px, float32; usable: the same shape, uint8, 0 where
    masked. weight (float32, as `out`) is set to (or, with `multiply`, multiplied by) `usable`
    there.
    """
    rows, columns = out.shape
    stride = coefficients.shape[1]
    flat, flat_usable = coefficients.reshape(-1), usable.reshape(-1)
    offset = np.empty(columns, np.int32)
    frac_x = np.empty(columns, float32)
    frac_y = np.empty(columns, float32)
    low = float32(1 - PAD)
    high_x = float32(columns + PAD - 3.01)
    high_y = float32(coefficients.shape[0] - PAD - 4.01)
    for r in range(rows):
        _split(
            float32(factor), dx[r], dy[r], first + r, low, high_x, high_y, np.int32(stride),
            offset, frac_x, frac_y,
        )  # fmt: skip
        c = 0
        while c < columns:
            end = run_end(offset, c)
            # what is written beyond the run is written again with the next one
            n = min((end - c + LANES - 1) // LANES * LANES, columns - c)
            p = (first + r + PAD - 1) * stride + PAD - 1 + c + offset[c]
            _sample_run(
                flat[p : p + n + 3], flat[p + stride : p + stride + n + 3],
                flat[p + 2 * stride : p + 2 * stride + n + 3],
                flat[p + 3 * stride : p + 3 * stride + n + 3],
                frac_x[c : c + n], frac_y[c : c + n], out[r, c : c + n],
            )  # fmt: skip
            q = p + stride + 1
            if multiply:
                weight[r, c:end] *= flat_usable[q : q + end - c]
            else:
                weight[r, c:end] = flat_usable[q : q + end - c]
            c = end
