"""Standard uncertainty of each vector from the spread of what its window's cells say (correlation statistics)."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from piv import refine
from piv.deform import Nodes

# Set on rendered images so that one standard uncertainty holds two thirds of the errors (74 % without); it holds 60-76 % in
# every condition of the benchmark but for structures shorter than the window, whose damping no noise estimate sees.
CALIBRATION = 0.86  # on the variance
LARGEST = 100.0  # px²
INTERPOLATION = 0.0005  # px: what sampling leaves however little noise there is


def correlation_statistics(nodes: Nodes, cells, sums, step_x, step_y, sigma: float, kept: float):
    """Variances (x, y, px²) of one measurement of each vector.

    The displacement solves H d = Σ w g over the window's cells; its covariance is H⁻¹ (Σ w² g gᵀ) H⁻¹, where g is
    what remains of each cell's gradient after the displacement found. Neighbouring cells are taken together because
    particle images span them (Wieneke 2015, with cells instead of pixels).
    step_x, step_y: last step (px of this level); kept: share of the noise that is left after it (noise_budget).
    """
    x, y = nodes.at_cells(step_x), nodes.at_cells(step_y)
    gx = cells[0] - cells[2] * x - cells[3] * y
    gy = cells[1] - cells[3] * x - cells[4] * y
    around = np.ones((3, 3), np.float32)
    sum_x = cv2.filter2D(gx, cv2.CV_32F, around, borderType=cv2.BORDER_CONSTANT)
    sum_y = cv2.filter2D(gy, cv2.CV_32F, around, borderType=cv2.BORDER_CONSTANT)
    products = np.stack([gx * sum_x, gy * sum_y, 0.5 * (gx * sum_y + gy * sum_x), gx * gx, gy * gy])
    # the square of a Gaussian weight is the Gaussian weight of σ/√2
    spread, _ = nodes.window_sums(products, sigma / np.sqrt(2))
    # a few dozen cells determine a variance poorly: average it over neighbouring windows
    spread = np.stack([cv2.GaussianBlur(s, (0, 0), 1.0, borderType=cv2.BORDER_REPLICATE) for s in spread])
    sxx, syy = np.maximum(spread[0], 0.3 * spread[3]), np.maximum(spread[1], 0.3 * spread[4])
    bound = 0.9 * np.sqrt(sxx * syy)
    sxy = np.clip(spread[2], -bound, bound)
    hxx, hxy, hyy = sums[2], sums[3], sums[4]
    # a window without texture knows nothing: its variance ends at LARGEST
    det = np.maximum(hxx * hyy - hxy**2, 1e-3 * np.maximum(sums[5] * sums[6], 1e-12))
    ixx, ixy, iyy = hyy / det, -hxy / det, hxx / det
    scale = CALIBRATION * nodes.factor**2 / kept
    var_x = ixx**2 * sxx + 2 * ixx * ixy * sxy + ixy**2 * syy
    var_y = ixy**2 * sxx + 2 * ixy * iyy * sxy + iyy**2 * syy
    return np.clip(var_x * scale, 0, LARGEST), np.clip(var_y * scale, 0, LARGEST)


@lru_cache
def noise_budget(sigma: float, spacing: float, passes: int) -> tuple[float, float]:
    """(variance of the iterated measurement over that of one window, share of noise left in the cells).

    Each pass replaces the vectors d by P d + G (n - P d): G is the response of the window (σ px), P that of the
    B-spline through vectors `spacing` px apart, n the noise of the images. Part of the noise is thus followed by
    the vectors and no longer seen in the cells.
    """
    k = np.fft.fftfreq(128, refine.CELL)
    square = k[:, None] ** 2 + k[None, :] ** 2
    spline = np.sinc(k * spacing) ** 4
    spline = spline[:, None] * spline[None, :]
    window = np.exp(-2 * np.pi**2 * sigma**2 * square)
    total = np.zeros_like(window)
    for _ in range(passes):
        total = spline * total + window * (1 - spline * total)
    box = (1 + 2 * np.cos(2 * np.pi * k * refine.CELL)) / 3
    box = box[:, None] * box[None, :]
    return float(np.sum(total**2) / np.sum(window**2)), float(np.sum((1 - total) ** 2 * box) / np.sum(box))


LAG = 2  # cells: farther apart than particle images reach, nearer than the shortest structures of interest
WIDER = 2.0  # times the window: area over which unresolved displacement is averaged
SURE = 4.0  # standard errors: below it what cells have in common may be noise


def unresolved(nodes: Nodes, cells, step_x, step_y, sigma: float):
    """Variances (x, y, px²) of displacement inside the windows that the vectors do not follow.

    Cells LAG apart share no particle, hence no noise: what the displacements left in them have in common is real,
    as where structures are shorter than the window. Zero where it does not stand out of the noise.
    """
    x, y = nodes.at_cells(step_x), nodes.at_cells(step_y)
    left = (cells[0] - cells[2] * x - cells[3] * y, cells[1] - cells[3] * x - cells[4] * y)
    width = WIDER * sigma / (nodes.factor * refine.CELL)
    count = 4 * np.pi * width**2 * 2
    apart = np.zeros((2 * LAG + 1, 2 * LAG + 1), np.float32)
    apart[0, LAG] = apart[-1, LAG] = apart[LAG, 0] = apart[LAG, -1] = 0.25

    def mean(field):
        return cv2.GaussianBlur(field, (0, 0), width, borderType=cv2.BORDER_REPLICATE)

    def neighbours(field):
        return cv2.filter2D(field, cv2.CV_32F, apart, borderType=cv2.BORDER_CONSTANT)

    out = []
    for g, h in ((left[0], cells[2]), (left[1], cells[4])):
        product = g * neighbours(g)
        shared = mean(product)
        error = np.sqrt(mean(product**2) / count * 2)
        curvature = np.maximum(mean(h * neighbours(h)), 1e-12)
        sure = shared > SURE * error
        grid = cv2.remap(
            np.where(sure, shared / curvature, 0).astype(np.float32),
            *_at_nodes(nodes),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        out.append(grid)
    return out[0], out[1]


def _at_nodes(nodes: Nodes) -> tuple[np.ndarray, np.ndarray]:
    """Positions of the nodes in cells, as maps for cv2.remap."""
    middle = (refine.CELL - 1) / 2
    i, j = (nodes.column - middle) / refine.CELL, (nodes.row - middle) / refine.CELL
    map_x, map_y = np.meshgrid(i.astype(np.float32), j.astype(np.float32))
    return map_x, map_y
