"""Image deformation at one resolution: warp both images half-way and measure what displacement remains."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from piv import refine
from piv.interpolate import PAD, bspline_table, dense_field, warp


@dataclass(frozen=True)
class Measurement:
    """Result of one step at the nodes, image axes, full-resolution px."""

    dx: np.ndarray
    dy: np.ndarray
    correlation: np.ndarray
    share: np.ndarray  # part of the window's weight that both images could use
    cells: np.ndarray  # moments of the cells, and their sums in the windows
    sums: np.ndarray


class Level:
    """Both images at one resolution (`factor` full pixels per pixel), ready to be sampled anywhere."""

    def __init__(self, images, seen, factor: int, kernel: np.ndarray, x: np.ndarray, y: np.ndarray):
        self.factor = factor
        self.shape = images[0].shape
        rows, columns = self.shape
        self.images = images
        self.usable = []
        for ok in seen:
            usable = np.ones(self.shape, np.uint8) if ok is None else ok.astype(np.uint8)
            usable = cv2.copyMakeBorder(usable, PAD, PAD, PAD, PAD, cv2.BORDER_CONSTANT, value=0)
            # a sample needs its four neighbours, a derivative those of its neighbours: 4 px in all
            self.usable.append(cv2.erode(usable, np.ones((9, 9), np.uint8)).astype(np.float32))
        self.set_kernel(kernel)
        self.x, self.y = (x + 0.5) / factor - 0.5, (y + 0.5) / factor - 0.5
        self.table_x = bspline_table(np.arange(columns), self.x[0], self.x[1] - self.x[0], x.size)
        self.table_y = bspline_table(np.arange(rows), self.y[0], self.y[1] - self.y[0], y.size)
        self.a, self.b, self.weight, self._dx, self._dy = (np.empty(self.shape, np.float32) for _ in range(5))

    def set_kernel(self, kernel: np.ndarray) -> None:
        """Images filtered by `kernel` (prefilter.kernel)."""
        self.coefficients = [
            cv2.copyMakeBorder(
                cv2.filter2D(image, cv2.CV_32F, kernel, borderType=cv2.BORDER_REFLECT_101),
                PAD, PAD, PAD, PAD, cv2.BORDER_CONSTANT, value=0,
            )
            for image in self.images
        ]  # fmt: skip

    def warp(self, dx: np.ndarray, dy: np.ndarray) -> None:
        """Sample both images at ∓ half of the smooth displacement through the nodes' vectors."""
        for knots, out in ((dx, self._dx), (dy, self._dy)):
            padded = np.pad(knots.astype(np.float32) / self.factor, 2, mode="edge")
            dense_field(padded, *self.table_y, *self.table_x, out)
        warp(self.coefficients[0], self.usable[0], self._dx, self._dy, -0.5, self.a, self.weight, False)
        warp(self.coefficients[1], self.usable[1], self._dx, self._dy, 0.5, self.b, self.weight, True)

    def measure(self, dx: np.ndarray, dy: np.ndarray, sigma: float, limit: float) -> Measurement:
        """One Newton step from the predictor (dx, dy) the images are warped by.

        sigma: the window's Gaussian weight (full px); limit: longest step (px of this level).
        """
        rows, columns = self.shape
        cells = np.empty((refine.MOMENTS, rows // refine.CELL, columns // refine.CELL), np.float32)
        refine.cell_moments(self.a, self.b, self.weight, cells)
        first_x, weight_x = refine.window_weights(self.x, cells.shape[2], sigma / self.factor)
        first_y, weight_y = refine.window_weights(self.y, cells.shape[1], sigma / self.factor)
        shape = (self.y.size, self.x.size)
        sums = np.empty((refine.MOMENTS, *shape), np.float32)
        refine.window_sums(cells, first_y, weight_y, first_x, weight_x, sums)
        step_x, step_y, correlation = (np.empty(shape, np.float32) for _ in range(3))
        refine.newton_step(sums, np.float32(limit), step_x, step_y, correlation)
        full = np.outer(weight_y.sum(axis=1), weight_x.sum(axis=1)) * refine.CELL**2
        return Measurement(
            smooth(dx) + step_x * self.factor, smooth(dy) + step_y * self.factor,
            correlation, sums[8] / full, cells, sums,
        )  # fmt: skip


def smooth(knots: np.ndarray) -> np.ndarray:
    """Value at the nodes of the B-spline that the images are warped by (weights 1/6, 2/3, 1/6)."""
    kernel = np.array([1, 4, 1], np.float32) / 6
    return cv2.sepFilter2D(knots.astype(np.float32), cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_REPLICATE)
