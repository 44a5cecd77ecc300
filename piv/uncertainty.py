"""Standard uncertainty of each vector from the spread of what the window's cells say (correlation statistics)."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from piv import refine
from piv.deform import Level, Measurement


def correlation_statistics(level: Level, m: Measurement, sigma: float, kept: float):
    """Covariance (var_x, var_y, cov_xy, px²) of one measurement of each vector at the converged displacement.

    The displacement solves H d = Σ w g over the window's cells; its covariance is H⁻¹ (Σ w² g·g) H⁻¹, where g is
    what remains of each cell's gradient after the displacement found, and neighbouring cells' products are
    included because a particle image spans them (Wieneke 2015, with cells instead of pixels).
    kept: share of the noise that is left in the cells after the predictor took its part (noise_budget).
    """
    cells = m.cells
    step_x, step_y = (_at_cells(level, f / level.factor, cells.shape[1:]) for f in (m.step_x, m.step_y))
    gx = cells[0] - cells[2] * step_x - cells[3] * step_y
    gy = cells[1] - cells[3] * step_x - cells[4] * step_y
    around = np.ones((3, 3), np.float32)
    sum_x = cv2.filter2D(gx, cv2.CV_32F, around, borderType=cv2.BORDER_CONSTANT)
    sum_y = cv2.filter2D(gy, cv2.CV_32F, around, borderType=cv2.BORDER_CONSTANT)
    products = np.stack([gx * sum_x, gy * sum_y, 0.5 * (gx * sum_y + gy * sum_x), gx * gx, gy * gy])
    # the square of a Gaussian weight is the Gaussian weight of σ/√2
    narrow = sigma / level.factor / np.sqrt(2)
    first_x, weight_x = refine.window_weights(level.x, cells.shape[2], narrow)
    first_y, weight_y = refine.window_weights(level.y, cells.shape[1], narrow)
    spread = np.empty((5, *m.dx.shape), np.float32)
    refine.window_sums(products.astype(np.float32), first_y, weight_y, first_x, weight_x, spread)
    # a few dozen cells determine a variance poorly: average it over neighbouring windows
    spread = np.stack([cv2.GaussianBlur(s, (0, 0), 1.0, borderType=cv2.BORDER_REPLICATE) for s in spread])
    sxx, syy = np.maximum(spread[0], 0.3 * spread[3]), np.maximum(spread[1], 0.3 * spread[4])
    sxy = np.clip(spread[2], -0.9 * np.sqrt(sxx * syy), 0.9 * np.sqrt(sxx * syy))
    hxx, hxy, hyy = m.sums[2], m.sums[3], m.sums[4]
    det = np.maximum(hxx * hyy - hxy**2, 1e-3 * np.maximum(m.sums[5] * m.sums[6], 1e-30))
    ixx, ixy, iyy = hyy / det, -hxy / det, hxx / det
    var_x = ixx**2 * sxx + 2 * ixx * ixy * sxy + ixy**2 * syy
    var_y = ixy**2 * sxx + 2 * ixy * iyy * sxy + iyy**2 * syy
    return var_x / kept, var_y / kept



@lru_cache
def noise_budget(sigma: float, spacing: float, passes: int) -> tuple[float, float]:
    """(variance of the iterated measurement over that of one window, share of noise left in the cells).

    Each pass replaces the vectors d by P d + G (n - P d): G is the response of the window (σ px), P that of the
    B-spline through vectors `spacing` px apart, n the noise of the images. Part of the noise is thus followed by
    the predictor and no longer seen in the cells.
    """
    k = np.fft.fftfreq(128, refine.CELL)
    square = k[:, None] ** 2 + k[None, :] ** 2
    spline = np.sinc(k * spacing) ** 4
    spline = spline[:, None] * spline[None, :]
    window = np.exp(-2 * np.pi**2 * sigma**2 * square)
    total = np.zeros_like(window)
    for _ in range(passes):
        before = spline * total
        total = before + window * (1 - before)
    box = (1 + 2 * np.cos(2 * np.pi * k * refine.CELL)) / 3
    box = box[:, None] * box[None, :]
    return float(np.sum(total**2) / np.sum(window**2)), float(np.sum((1 - total) ** 2 * box) / np.sum(box))


def _at_cells(level: Level, field: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Bilinear values of a field on the nodes at the centres of the cells."""
    centre_y = np.arange(shape[0]) * refine.CELL + (refine.CELL - 1) / 2
    centre_x = np.arange(shape[1]) * refine.CELL + (refine.CELL - 1) / 2
    jy = (centre_y - level.y[0]) / (level.y[1] - level.y[0])
    jx = (centre_x - level.x[0]) / (level.x[1] - level.x[0])
    grid_x, grid_y = np.meshgrid(jx.astype(np.float32), jy.astype(np.float32))
    return cv2.remap(field, grid_x, grid_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
