"""Image deformation: pixel displacements from the nodes', and images sampled along them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy import float32, ndarray

from piv.correlation.buffers import New, fresh
from piv.correlation.interpolate import PAD, bilinear, bspline_table, dense_field, warp
from piv.correlation.newton_step import CELL, MOMENTS, window_reach, window_sums, window_weights
from piv.correlation.pair_moments import pair_moments
from piv.correlation.prefilter import TAPS, Kernel, apply


@dataclass(frozen=True, eq=False)
class Nodes:
    """Regular nodes (column `x`, row `y`, full px) on images of `shape`, `factor` times coarser."""

    x: ndarray
    y: ndarray
    shape: tuple[int, int]
    factor: int

    @cached_property
    def column(self) -> ndarray:
        """Column of every node in px of this level."""
        return (self.x + 0.5) / self.factor - 0.5

    @cached_property
    def row(self) -> ndarray:
        """Row of every node in px of this level."""
        return (self.y + 0.5) / self.factor - 0.5

    @cached_property
    def _tables(self) -> tuple[ndarray, ndarray, ndarray, ndarray]:
        rows, columns = self.shape
        step_x, step_y = self.column[1] - self.column[0], self.row[1] - self.row[0]
        along_y = bspline_table(np.arange(rows), self.row[0], step_y, self.y.size)
        along_x = bspline_table(np.arange(columns), self.column[0], step_x, self.x.size)
        return along_y[0], along_y[1], along_x[0], along_x[1]

    @cached_property
    def _windows(self) -> dict[float, tuple]:
        """Weights of the cells around the nodes, and their sums, of the σ used so far."""
        return {}

    def _knots(self, vectors: ndarray, share: float) -> ndarray:
        """B-spline coefficients of `share` of the vectors (px of this level), padded by two."""
        padded = np.empty((vectors.shape[0] + 4, vectors.shape[1] + 4), float32)
        np.multiply(
            vectors, float32(share / self.factor), out=padded[2:-2, 2:-2], casting="same_kind"
        )
        padded[:2], padded[-2:] = padded[2], padded[-3]
        padded[:, :2], padded[:, -2:] = padded[:, 2:3], padded[:, -3:-2]
        return padded

    def moments(
        self, a: Image, b: Image, dx: ndarray, dy: ndarray, wanted: ndarray | None = None
    ) -> ndarray:
        """Products (MOMENTS, *cell_shape) of both images, warped half-way along (dx, dy), per cell.

        wanted: cells (uint8) that are measured, None for all; the others are zero.
        """
        if wanted is None:
            wanted = np.ones(self.cell_shape, np.uint8)
        cells = np.zeros((MOMENTS, *self.cell_shape), float32)
        x, y = self._knots(dx, -0.5), self._knots(dy, -0.5)
        around = cv2.dilate(wanted, np.ones((3, 3), np.uint8))
        pair_moments(
            a.samples, a.usable, b.samples, b.usable, x, y, *self._tables, wanted, around, cells
        )
        return cells

    def dense(self, vectors: ndarray, out: ndarray, first: int = 0) -> None:
        """B-spline with the vectors as coefficients (px of this level), rows from `first` on."""
        padded = self._knots(vectors, 1.0)
        first_y, weights_y, first_x, weights_x = self._tables
        rows = slice(first, first + out.shape[0])
        first_y = first_y[rows]
        padded = padded[first_y[0] : first_y[-1] + 4]
        dense_field(padded, first_y - first_y[0], weights_y[:, rows], first_x, weights_x, out)

    @property
    def cell_shape(self) -> tuple[int, int]:
        """Number of cells (rows, columns) over which the images' products are summed."""
        return self.shape[0] // CELL, self.shape[1] // CELL

    def window_sums(self, cells: ndarray, sigma: float) -> tuple[ndarray, ndarray]:
        """Gaussian-weighted sums of the cells round each node (σ in full px); their weight."""
        if sigma not in self._windows:
            rows, columns = self.cell_shape
            first_x, weight_x = window_weights(self.column, columns, sigma / self.factor)
            first_y, weight_y = window_weights(self.row, rows, sigma / self.factor)
            total = np.outer(weight_y.sum(axis=1), weight_x.sum(axis=1)) * CELL**2
            self._windows[sigma] = (first_y, weight_y, first_x, weight_x), total
        (first_y, weight_y, first_x, weight_x), total = self._windows[sigma]
        sums = np.empty((cells.shape[0], self.y.size, self.x.size), float32)
        window_sums(cells, first_y, weight_y, first_x, weight_x, sums)
        return sums, total

    def cells_around(self, where: ndarray, sigma: float) -> ndarray:
        """Cells (uint8) in the windows (σ in full px) of the nodes `where` (bool)."""
        seen = np.zeros(self.cell_shape, np.uint8)
        rows, columns = (
            np.clip(np.rint((at - (CELL - 1) / 2) / CELL).astype(int), 0, n - 1)
            for at, n in zip((self.row, self.column), self.cell_shape, strict=True)
        )
        j, i = np.nonzero(where)
        seen[rows[j], columns[i]] = 1
        across = 2 * window_reach(sigma / self.factor) + 1
        return cv2.dilate(seen, np.ones((across, across), np.uint8))

    def at_cells(self, field: ndarray) -> ndarray:
        """Bilinear values of a field on the nodes at the centres of the cells."""
        rows, columns = self.cell_shape
        middle = (CELL - 1) / 2
        i = (np.arange(columns) * CELL + middle - self.column[0]) / (
            self.column[1] - self.column[0]
        )
        j = (np.arange(rows) * CELL + middle - self.row[0]) / (self.row[1] - self.row[0])
        return bilinear(field, i, j)

    def from_cells(self, field: ndarray) -> ndarray:
        """Bilinear values at the nodes of a field on the centres of the cells."""
        middle = (CELL - 1) / 2
        return bilinear(field, (self.column - middle) / CELL, (self.row - middle) / CELL)


def inside(seen: ndarray) -> ndarray:
    """Padded map (uint8) of the pixels whose sample and derivatives use unmasked pixels only."""
    usable = cv2.copyMakeBorder(
        seen.astype(np.uint8), PAD, PAD, PAD, PAD, cv2.BORDER_CONSTANT, value=(0,)
    )
    # a sample needs its four neighbours, a derivative those of its own neighbours: 4 px in all
    return cv2.erode(usable, np.ones((9, 9), np.uint8))


@lru_cache(8)
def _usable_samples(shape: tuple[int, int]) -> ndarray:
    """`inside` of an image without a mask; shared, read only."""
    return inside(np.ones(shape, bool))


class Image:
    """One image at one resolution, filtered and ready to be sampled anywhere."""

    def __init__(self, pixels: ndarray, seen: ndarray | None, new: New = fresh):
        """pixels: float32 without background; seen: unmasked pixels. Call `filter` next."""
        self.pixels = pixels
        self.usable = _usable_samples(pixels.shape) if seen is None else inside(seen)
        self.warped = new(*pixels.shape)
        self.samples = new(*(n + 2 * PAD for n in pixels.shape))
        self.samples[:PAD] = self.samples[-PAD:] = self.samples[:, :PAD] = self.samples[
            :, -PAD:
        ] = 0
        self._kernel: Kernel | None = None

    def filter(self, kernel: Kernel) -> None:
        """Filter the pixels for sampling, unless this kernel was the last one."""
        if kernel is not self._kernel:
            apply(self.pixels, kernel, self.samples[PAD:-PAD, PAD:-PAD])
            self._kernel = kernel

    def filter_rows(self, kernel: Kernel, first: int, last: int) -> None:
        """Filter rows `first` to `last` only; `filter` then starts anew."""
        rows = self.pixels.shape[0]
        first, last = max(first, 0), min(last, rows)
        low, high = max(first - TAPS, 0), min(last + TAPS, rows)
        part = apply(self.pixels[low:high], kernel)
        self.samples[PAD + first : PAD + last, PAD:-PAD] = part[first - low : last - low]
        self._kernel = None

    def crop(self, top: int, bottom: int, left: int, right: int) -> Image:
        """A copy of a part of the filtered image, with PAD px around it for samples."""
        part = object.__new__(Image)
        padded = (slice(top, bottom + 2 * PAD), slice(left, right + 2 * PAD))
        part.pixels = self.pixels[top:bottom, left:right]
        part.usable, part.samples = self.usable[padded].copy(), self.samples[padded].copy()
        return part

    def warp(
        self,
        dx: ndarray,
        dy: ndarray,
        share: float,
        weight: ndarray,
        multiply: bool,
        first: int = 0,
    ) -> ndarray:
        """Rows from `first` on, sampled along `share` of a displacement (interpolate.warp)."""
        out = self.warped[first : first + dx.shape[0]]
        warp(self.samples, self.usable, dx, dy, share, first, out, weight, multiply)
        return out


def spline_value(vectors: ndarray) -> ndarray:
    """B-spline with these coefficients at its nodes (weights 1/6, 2/3, 1/6): the warp there."""
    kernel = np.array([1, 4, 1], float32) / 6
    return cv2.sepFilter2D(
        vectors.astype(float32), cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_REPLICATE
    )


_BORDER = 4  # nodes round a region that are measured with it; more where its windows reach farther

Box = tuple[slice, slice]  # rows and columns of nodes


def with_border(box: Box, nodes: Nodes, sigma: float) -> Box:
    """A box with the nodes round it that warp the images in its windows (σ in px)."""
    border = max(_BORDER, int(np.ceil(window_reach(sigma) * CELL / (nodes.x[1] - nodes.x[0]))))
    rows, columns = (
        slice(max(s.start - border, 0), min(s.stop + border, axis.size))
        for s, axis in zip(box, (nodes.y, nodes.x), strict=True)
    )
    return rows, columns


def cut(
    nodes: Nodes, images: list[Image], part: Box, density: int, sigma: float
) -> tuple[Nodes, list[Image]]:
    """Nodes of a part, `density` times as dense, and images with a margin for its windows (px)."""
    margin = (window_reach(sigma) + 1) * CELL
    spans = []
    for axis, s, length in ((nodes.x, part[1], nodes.shape[1]), (nodes.y, part[0], nodes.shape[0])):
        first = max(int(axis[s.start]) - margin, 0) // CELL * CELL
        spans.append((first, min(int(axis[s.stop - 1]) + margin, length)))
    (c0, c1), (r0, r1) = spans
    near = nodes.x[part[1]], nodes.y[part[0]]
    x, y = (np.linspace(a[0], a[-1], density * (a.size - 1) + 1) for a in near)
    local = Nodes(x - c0, y - r0, (r1 - r0, c1 - c0), 1)
    return local, images if local.shape == nodes.shape else [i.crop(r0, r1, c0, c1) for i in images]
