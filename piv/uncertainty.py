"""Standard uncertainty of each vector from the spread of what the window's cells say (correlation statistics)."""

from __future__ import annotations

import cv2
import numpy as np

from piv import refine
from piv.deform import Level, Measurement


def correlation_statistics(level: Level, m: Measurement, dx, dy, sigma: float):
    """Covariance (var_x, var_y, cov_xy, px²) of one measurement of each vector at the converged displacement.

    The displacement solves H d = Σ w g over the window's cells; its covariance is H⁻¹ (Σ w² g·g) H⁻¹, where g is
    what remains of each cell's gradient after the displacement found, and neighbouring cells' products are
    included because a particle image spans them (Wieneke 2015, with cells instead of pixels).
    dx, dy: the measurement less its predictor at the nodes (px of this level).
    """
    cells = m.cells
    step_x, step_y = (_at_cells(level, f, cells.shape[1:]) for f in (dx, dy))
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
    spread = np.empty((5, *dx.shape), np.float32)
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
    return var_x, var_y


def _at_cells(level: Level, field: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Bilinear values of a field on the nodes at the centres of the cells."""
    centre_y = np.arange(shape[0]) * refine.CELL + (refine.CELL - 1) / 2
    centre_x = np.arange(shape[1]) * refine.CELL + (refine.CELL - 1) / 2
    jy = (centre_y - level.y[0]) / (level.y[1] - level.y[0])
    jx = (centre_x - level.x[0]) / (level.x[1] - level.x[0])
    grid_x, grid_y = np.meshgrid(jx.astype(np.float32), jy.astype(np.float32))
    return cv2.remap(
        field.astype(np.float32), grid_x, grid_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
