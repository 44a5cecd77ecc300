"""Image deformation: vectors at nodes to a displacement of every pixel, and images sampled where it points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np

from piv.correlation import newton_step as refine
from piv.correlation.buffers import New, fresh
from piv.correlation.interpolate import PAD, bspline_table, dense_field, warp
from piv.correlation.pair_moments import pair_moments
from piv.correlation.prefilter import TAPS, Kernel, apply


@dataclass(frozen=True, eq=False)
class Nodes:
    """Regular nodes (column `x`, row `y`, full px) on images of `shape` that are `factor` times coarser."""

    x: np.ndarray
    y: np.ndarray
    shape: tuple[int, int]
    factor: int

    @property
    def column(self) -> np.ndarray:
        """Column of every node in px of this level."""
        return (self.x + 0.5) / self.factor - 0.5

    @property
    def row(self) -> np.ndarray:
        """Row of every node in px of this level."""
        return (self.y + 0.5) / self.factor - 0.5

    @cached_property
    def _tables(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        rows, columns = self.shape
        step_x, step_y = self.column[1] - self.column[0], self.row[1] - self.row[0]
        along_y = bspline_table(np.arange(rows), self.row[0], step_y, self.y.size)
        along_x = bspline_table(np.arange(columns), self.column[0], step_x, self.x.size)
        return along_y[0], along_y[1], along_x[0], along_x[1]

    def _knots(self, vectors: np.ndarray, share: float) -> np.ndarray:
        """Coefficients of the B-spline of `share` of the vectors in px of this level, two more on every side."""
        padded = np.empty((vectors.shape[0] + 4, vectors.shape[1] + 4), np.float32)
        np.multiply(vectors, np.float32(share / self.factor), out=padded[2:-2, 2:-2], casting="same_kind")
        padded[:2], padded[-2:] = padded[2], padded[-3]
        padded[:, :2], padded[:, -2:] = padded[:, 2:3], padded[:, -3:-2]
        return padded

    def moments(self, a: Image, b: Image, dx: np.ndarray, dy: np.ndarray) -> np.ndarray:
        """Products (MOMENTS, *cell_shape) of both images warped half-way along the B-spline of (dx, dy), summed over cells."""
        cells = np.empty((refine.MOMENTS, *self.cell_shape), np.float32)
        x, y = self._knots(dx, -0.5), self._knots(dy, -0.5)
        pair_moments(a.samples, a.usable, b.samples, b.usable, x, y, *self._tables, cells)
        return cells

    def dense(self, vectors: np.ndarray, out: np.ndarray, first: int = 0) -> None:
        """Value at every pixel of the rows from `first` on, in px of this level, of the B-spline whose coefficients the vectors are."""
        padded = self._knots(vectors, 1.0)
        first_y, weights_y, first_x, weights_x = self._tables
        rows = slice(first, first + out.shape[0])
        first_y = first_y[rows]
        padded = padded[first_y[0] : first_y[-1] + 4]
        dense_field(padded, first_y - first_y[0], weights_y[:, rows], first_x, weights_x, out)

    @property
    def cell_shape(self) -> tuple[int, int]:
        """Cells (rows, columns) that the images' products are summed over."""
        return self.shape[0] // refine.CELL, self.shape[1] // refine.CELL

    def window_sums(self, cells: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
        """Gaussian-weighted sums of the cells around each node (σ in full px), and the sum of the weights in px²."""
        first_x, weight_x = refine.window_weights(self.column, cells.shape[2], sigma / self.factor)
        first_y, weight_y = refine.window_weights(self.row, cells.shape[1], sigma / self.factor)
        sums = np.empty((cells.shape[0], self.y.size, self.x.size), np.float32)
        refine.window_sums(cells, first_y, weight_y, first_x, weight_x, sums)
        return sums, np.outer(weight_y.sum(axis=1), weight_x.sum(axis=1)) * refine.CELL**2

    def at_cells(self, field: np.ndarray) -> np.ndarray:
        """Bilinear values of a field on the nodes at the centres of the cells."""
        rows, columns = self.cell_shape
        middle = (refine.CELL - 1) / 2
        i = (np.arange(columns) * refine.CELL + middle - self.column[0]) / (self.column[1] - self.column[0])
        j = (np.arange(rows) * refine.CELL + middle - self.row[0]) / (self.row[1] - self.row[0])
        map_x, map_y = np.meshgrid(i.astype(np.float32), j.astype(np.float32))
        field = field.astype(np.float32)
        return cv2.remap(field, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def inside(seen: np.ndarray) -> np.ndarray:
    """Padded map (uint8) of where a sample and its derivatives see nothing but pixels that may be used."""
    usable = cv2.copyMakeBorder(seen.astype(np.uint8), PAD, PAD, PAD, PAD, cv2.BORDER_CONSTANT, value=(0,))
    # a sample needs its four neighbours, a derivative those of its own neighbours: 4 px in all
    return cv2.erode(usable, np.ones((9, 9), np.uint8))


@lru_cache(8)
def usable_samples(shape: tuple[int, int]) -> np.ndarray:
    """`inside` of an image without a mask; shared, to be read only."""
    return inside(np.ones(shape, bool))


class Image:
    """One image at one resolution, filtered and ready to be sampled anywhere."""

    def __init__(self, pixels: np.ndarray, seen: np.ndarray | None, new: New = fresh):
        """pixels: float32 without background; seen: bool or None (all); new: where arrays come from. Filter it first."""
        self.pixels = pixels
        self.usable = usable_samples(pixels.shape) if seen is None else inside(seen)
        self.warped = new(*pixels.shape)
        self.samples = new(*(n + 2 * PAD for n in pixels.shape))
        self.samples[:PAD] = self.samples[-PAD:] = self.samples[:, :PAD] = self.samples[:, -PAD:] = 0
        self._kernel: Kernel | None = None

    def filter(self, kernel: Kernel) -> None:
        """Prepare the pixels for sampling, where that was not done with this kernel before."""
        if kernel is not self._kernel:
            apply(self.pixels, kernel, self.samples[PAD:-PAD, PAD:-PAD])
            self._kernel = kernel

    def filter_rows(self, kernel: Kernel, first: int, last: int) -> None:
        """Prepare rows `first` to `last` only; `filter` prepares all again."""
        rows = self.pixels.shape[0]
        first, last = max(first, 0), min(last, rows)
        low, high = max(first - TAPS, 0), min(last + TAPS, rows)
        part = apply(self.pixels[low:high], kernel)
        self.samples[PAD + first : PAD + last, PAD:-PAD] = part[first - low : last - low]
        self._kernel = None

    def crop(self, top: int, bottom: int, left: int, right: int) -> Image:
        """A copy of a part of the image as it is filtered now; its samples may lie up to PAD px outside the part."""
        part = object.__new__(Image)
        padded = (slice(top, bottom + 2 * PAD), slice(left, right + 2 * PAD))
        part.pixels = self.pixels[top:bottom, left:right]
        part.usable, part.samples = self.usable[padded].copy(), self.samples[padded].copy()
        return part

    def warp(
        self, dx: np.ndarray, dy: np.ndarray, share: float, weight: np.ndarray, multiply: bool, first: int = 0
    ) -> np.ndarray:
        """The image at positions moved by `share` of the dense displacement of its rows from `first` on; `weight`: see interpolate.warp."""
        out = self.warped[first : first + dx.shape[0]]
        warp(self.samples, self.usable, dx, dy, share, first, out, weight, multiply)
        return out


def spline_value(vectors: np.ndarray) -> np.ndarray:
    """Value at the nodes of the B-spline that images are warped by (weights 1/6, 2/3, 1/6)."""
    kernel = np.array([1, 4, 1], np.float32) / 6
    return cv2.sepFilter2D(
        vectors.astype(np.float32), cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_REPLICATE
    )
