"""Standard uncertainty of each vector by correlation statistics over the cells of its window."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy import ndarray

from piv.correlation.cell_moments import CELL
from piv.correlation.newton_step import Displacements
from piv.correlation.nodes import Nodes
from piv.correlation.options import Options
from piv.validation.outliers import fill_absent

# Set on rendered images so that one standard uncertainty covers two thirds of the errors (74 %
# without). It covers 60-76 % in every condition of the benchmark except structures shorter than the
# window, whose damping is no noise.
CALIBRATION = 0.86  # on the variance
# factor of neighbouring cells on the variance in small windows; set on a sine of 32 px
ALIKE = 1.75
# residual share of the noise below which neighbouring cells hold none
LEAST_KEPT = 0.25
LARGEST = 100.0  # px²
SMALL = 0.5  # side of the last window of steep regions over the largest
FEW = 5.0  # cells with texture: with so few in a window the variance doubles
# the same below LEAST_KEPT: 5 leaves a tenth of sparse images' vectors wrong, 9 rejects dense ones
FEW_SMALL = 7.0
INTERPOLATION = 0.0005  # px: interpolation error without any noise
# Squared second differences over REACH windows tell turbulence below the windows: over twice the
# distance they grow by 2^STEEP[0] there. In flows that the windows resolve they grow by 2^STEEP[1]
# (a sine of 64 px) or more.
STEEP, REACH = (1.6, 2.0), 0.6
# The variance of that turbulence over the squared differences: where windows are too small for
# their residuals to show it, and where they adapted. Those count most of it with the noise.
UNSEEN, UNSEEN_ADAPTED = 0.02, 0.004


class Errors(NamedTuple):
    """Variances (px²) of each vector: of its noise, and of displacement it does not resolve."""

    var_x: ndarray
    var_y: ndarray
    missed_x: ndarray
    missed_y: ndarray

    def in_small_window(self, v: Displacements) -> Errors:
        """With the small window of steep regions: noise variance grows by the ratio of areas."""
        if v.steep is None:
            return self
        where = v.steep if v.ratio is None else v.steep & (v.ratio == 1)
        x, y = (np.where(where, var / SMALL**2, var) for var in (self.var_x, self.var_y))
        return self._replace(var_x=x, var_y=y)


def errors_of(nodes: Nodes, v: Displacements, options: Options) -> Errors:
    """`Errors` of vectors measured in the window."""
    spacing = float(nodes.x[1] - nodes.x[0])
    sigma, passes, alike, few = options.sigma, options.full_steps, 0.0, FEW
    if noise_budget(sigma, spacing, passes)[1] < LEAST_KEPT:
        alike, few = ALIKE, FEW_SMALL
    gain, kept = noise_budget(sigma, spacing, passes, not alike)
    var = correlation_statistics(nodes, v, sigma, kept, alike, few)
    missed = unresolved(nodes, v, options.sigma)
    return Errors(gain * var[0], gain * var[1], *missed)


def residual_gradients(nodes: Nodes, v: Displacements) -> tuple[ndarray, ndarray]:
    """Gradients of the cells' correlation (x, y) that the last step leaves."""
    x, y = nodes.at_cells(v.step_x), nodes.at_cells(v.step_y)
    cells = v.cells
    return cells[0] - cells[2] * x - cells[3] * y, cells[1] - cells[3] * x - cells[4] * y


def correlation_statistics(
    nodes: Nodes, v: Displacements, sigma: float, kept: float, alike: float = 0.0, few: float = FEW
):
    """Variances (x, y, px²) of one measurement of each vector.

    The displacement solves H d = Σ w g over the window's cells; its covariance is H⁻¹ (Σ w² g gᵀ)
    H⁻¹, where g is the residual of each cell's gradient. Products with the neighbouring cells are
    included because particle images span several cells (Wieneke 2015, with cells instead of
    pixels). kept: residual share of the noise after it (noise_budget). alike: where positive, a
    factor on the variance of single cells in place of the sum over neighbouring cells, whose
    residuals are uncorrelated where the vectors follow the noise of small windows. few: number of
    cells with texture at which the variance doubles; 0: never.
    """
    gx, gy = residual_gradients(nodes, v)
    cells, sums = v.cells, v.sums
    around = np.ones((3, 3), np.float32)
    sum_x = cv2.filter2D(gx, cv2.CV_32F, around, borderType=cv2.BORDER_CONSTANT)
    sum_y = cv2.filter2D(gy, cv2.CV_32F, around, borderType=cv2.BORDER_CONSTANT)
    products = [gx * sum_x, gy * sum_y, 0.5 * (gx * sum_y + gy * sum_x), gx * gx, gy * gy]
    products.append((cells[2] + cells[4]) ** 2)
    # the square of a Gaussian weight is the Gaussian weight of σ/√2
    spread, _ = nodes.window_sums(np.stack(products), sigma / np.sqrt(2))
    # one or two particles per window show no spread, whatever the flow is between them
    texture = np.maximum(sums[2] + sums[4], 0)
    count = texture**2 / np.maximum(spread[5], 1e-12)  # cells that make up the window
    doubt = (few / np.maximum(count, max(0.1 * few, 1e-12))) ** 2
    # a few dozen cells determine a variance poorly: average it over neighbouring windows
    width = max(8.0 / float(nodes.x[1] - nodes.x[0]), 1.0)
    spread = np.stack(
        [cv2.GaussianBlur(s, (0, 0), width, borderType=cv2.BORDER_REPLICATE) for s in spread[:5]]
    )
    sxx, syy = np.maximum(spread[0], 0.3 * spread[3]), np.maximum(spread[1], 0.3 * spread[4])
    if alike:
        sxx, syy = alike * spread[3], alike * spread[4]
    bound = 0.9 * np.sqrt(sxx * syy)
    sxy = np.clip(spread[2], -bound, bound)
    hxx, hxy, hyy = sums[2], sums[3], sums[4]
    # without texture the variance ends at LARGEST
    det = np.maximum(hxx * hyy - hxy**2, 1e-3 * np.maximum(sums[5] * sums[6], 1e-12))
    ixx, ixy, iyy = hyy / det, -hxy / det, hxx / det
    scale = CALIBRATION * nodes.factor**2 / kept * (1 + doubt)
    var_x = ixx**2 * sxx + 2 * ixx * ixy * sxy + ixy**2 * syy
    var_y = ixy**2 * sxx + 2 * ixy * iyy * sxy + iyy**2 * syy
    return np.clip(var_x * scale, 0, LARGEST), np.clip(var_y * scale, 0, LARGEST)


@lru_cache
def noise_budget(
    sigma: float, spacing: float, passes: int, neighbours: bool = True
) -> tuple[float, float]:
    """(variance of the iterated measurement over one window's, share of noise left in the cells).

    Each pass replaces the vectors d by P d + G (n - P d): G is the response of the window (σ px), P
    that of the B-spline through vectors `spacing` px apart, n the noise of the images. The vectors
    thus follow part of the noise, which the cells no longer hold. neighbours: the share in sums
    over neighbouring cells.
    """
    k = np.fft.fftfreq(128, CELL)
    square = k[:, None] ** 2 + k[None, :] ** 2
    spline = np.sinc(k * spacing) ** 4
    spline = spline[:, None] * spline[None, :]
    window = np.exp(-2 * np.pi**2 * sigma**2 * square)
    total = np.zeros_like(window)
    for _ in range(passes):
        total = spline * total + window * (1 - spline * total)
    box = (1 + 2 * np.cos(2 * np.pi * k * CELL)) / 3 if neighbours else np.ones_like(k)
    box = box[:, None] * box[None, :]
    return float(np.sum(total**2) / np.sum(window**2)), float(
        np.sum((1 - total) ** 2 * box) / np.sum(box)
    )


_LAG = 2  # cells: longer than particle images, shorter than the structures of interest
WIDER = 2.0  # windows: width of the area over which unresolved displacement is averaged
SURE = 4.0  # standard errors above which residual correlation is not noise


def unresolved(nodes: Nodes, v: Displacements, sigma: float):
    """Variances (x, y, px²) of the displacement inside the windows that the vectors do not resolve.

    Cells LAG apart share no particle, hence no noise: a correlation of their residual displacements
    is flow, as where structures are shorter than the window. Zero where it is not significant.
    """
    left, cells = residual_gradients(nodes, v), v.cells
    width = WIDER * sigma / (nodes.factor * CELL)
    count = 4 * np.pi * width**2 * 2
    apart = np.zeros(2 * _LAG + 1, np.float32)
    apart[0] = apart[-1] = 0.5

    def mean(field):
        return cv2.GaussianBlur(field, (0, 0), width, borderType=cv2.BORDER_REPLICATE)

    out = []
    for g, h in ((left[0], cells[2]), (left[1], cells[4])):
        variance = np.zeros(g.shape, np.float32)
        # short waves correlate along their crests only: each direction separately
        for kernel in (apart[:, None], apart[None, :]):
            product = g * cv2.filter2D(g, cv2.CV_32F, kernel, borderType=cv2.BORDER_CONSTANT)
            shared = mean(product)
            sure = shared > SURE * np.sqrt(mean(product**2) / count * 2)
            if sure.any():
                other = cv2.filter2D(h, cv2.CV_32F, kernel, borderType=cv2.BORDER_CONSTANT)
                curvature = np.maximum(mean(h * other), 1e-12)
                variance = np.maximum(variance, np.where(sure, shared / curvature, 0))
        out.append(nodes.from_cells(variance))
    return out[0], out[1]


def unseen(nodes: Nodes, v: Displacements, variance: ndarray, options: Options) -> ndarray:
    """Variances (2, y, x; px²) of turbulence below windows whose residuals do not show it.

    Where the second differences over half a window grow with distance as slowly as in turbulence,
    the spectrum goes on below the window: its variance there is a share of theirs, without noise.
    variance: (2, y, x), of the noise.
    """
    spacing = float(nodes.x[1] - nodes.x[0])
    share = np.zeros(v.dx.shape, np.float32)
    if noise_budget(options.sigma, spacing, options.full_steps)[1] < LEAST_KEPT:
        share[:] = UNSEEN
    elif v.ratio is not None:
        share[v.ratio < 1] = UNSEEN_ADAPTED
    if not (share.any() and v.known.any()):
        return np.zeros_like(variance)
    reach, width = max(1, round(REACH * options.window / spacing)), WIDER * options.window / spacing
    weight = v.known.astype(np.float32)

    def mean(field: ndarray) -> ndarray:
        blurred = (cv2.GaussianBlur(f * weight, (0, 0), width) for f in (field, weight))
        return next(blurred) / np.maximum(next(blurred), 1e-6)

    fields = fill_absent(v.dx, v.dy, v.known)
    near, far = (
        np.stack([mean(_second_differences(f, k * reach)) for f in fields]) for k in (1, 2)
    )
    noise = np.stack([mean(np.where(v.known, part, 0)) for part in variance])
    near, far = (np.maximum(part - noise, 1e-12) for part in (near, far))
    growth = np.log2(far.sum(axis=0) / near.sum(axis=0))
    return share * np.interp(growth, STEEP, (1, 0)).astype(np.float32) * near


def _second_differences(field: ndarray, reach: int) -> ndarray:
    """Squares of the differences from the mean of four neighbours, `reach` nodes away."""
    wide = np.pad(field, reach, mode="reflect", reflect_type="odd")
    rows, columns = field.shape
    middle, far = reach, 2 * reach
    around = sum(
        wide[j : j + rows, i : i + columns]
        for j, i in ((0, middle), (far, middle), (middle, 0), (middle, far))
    )
    return np.square(field - around / 4).astype(np.float32)
