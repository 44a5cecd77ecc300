"""The vectors' nodes: displacements of all pixels between them, and sums over their windows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy import float32, ndarray

from piv.compiled import fast
from piv.correlation.cell_moments import CELL, MOMENTS
from piv.correlation.interpolate import bspline_table, dense_field
from piv.correlation.options import Options
from piv.correlation.pair_images import Image
from piv.correlation.pair_moments import pair_moments


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
            first_x, weight_x = _window_weights(self.column, columns, sigma / self.factor)
            first_y, weight_y = _window_weights(self.row, rows, sigma / self.factor)
            total = np.outer(weight_y.sum(axis=1), weight_x.sum(axis=1)) * CELL**2
            self._windows[sigma] = (first_y, weight_y, first_x, weight_x), total
        (first_y, weight_y, first_x, weight_x), total = self._windows[sigma]
        sums = np.empty((cells.shape[0], self.y.size, self.x.size), float32)
        _window_sums(cells, first_y, weight_y, first_x, weight_x, sums)
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
        across = 2 * _window_reach(sigma / self.factor) + 1
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


def _window_reach(sigma: float) -> int:
    """Cells on each side of a node that have weight in a window of this σ (px)."""
    return int(np.ceil(3.0 * sigma / CELL)) + 1


def _window_weights(nodes: ndarray, cells: int, sigma: float) -> tuple[ndarray, ndarray]:
    """Gaussian weights of the cells round each node: (first cell, weights (node, cell))."""
    reach = _window_reach(sigma)
    centre = (nodes - (CELL - 1) / 2) / CELL
    first = np.floor(centre).astype(np.int64) - reach
    k = first[:, None] + np.arange(2 * reach + 2)
    w = np.exp(-0.5 * ((k - centre[:, None]) * CELL / sigma) ** 2)
    w[(k < 0) | (k >= cells)] = 0
    return first, w.astype(float32)


@fast
def _dot(a, b):
    total = float32(0)
    for k in range(a.size):
        total += a[k] * b[k]
    return total


@fast
def _add(line, weight, row):
    for c in range(line.size):
        line[c] += weight * row[c]


@fast
def _window_sums(moments, first_y, weight_y, first_x, weight_x, out):
    """out[m, j, i] = Σ weight_y[j] weight_x[i] moments[m] around node (j, i)."""
    count, _, cells_x = moments.shape
    ny, ky = weight_y.shape
    nx, kx = weight_x.shape
    padded = np.zeros(cells_x + 2 * kx, float32)  # cells beyond the image count as zero
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


def bilinear(field: ndarray, column: ndarray, row: ndarray) -> ndarray:
    """Bilinear values of a grid at every pair of a row and a column; constant outside."""
    at = np.empty((2, row.size, column.size), float32)
    at[0], at[1] = column, row[:, None]
    return cv2.remap(
        field.astype(float32), at[0], at[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )


def denser(field: ndarray) -> ndarray:
    """Bilinear values on nodes twice as dense."""
    rows, columns = field.shape
    across = np.empty((rows, 2 * columns - 1), float32)
    across[:, ::2] = field
    across[:, 1::2] = (field[:, 1:] + field[:, :-1]) / 2
    out = np.empty((2 * rows - 1, across.shape[1]), float32)
    out[::2] = across
    out[1::2] = (across[1:] + across[:-1]) / 2
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
    border = max(_BORDER, int(np.ceil(_window_reach(sigma) * CELL / (nodes.x[1] - nodes.x[0]))))
    rows, columns = (
        slice(max(s.start - border, 0), min(s.stop + border, axis.size))
        for s, axis in zip(box, (nodes.y, nodes.x), strict=True)
    )
    return rows, columns


def cut(
    nodes: Nodes, images: list[Image], part: Box, density: int, sigma: float
) -> tuple[Nodes, list[Image]]:
    """Nodes of a part, `density` times as dense, and images with a margin for its windows (px)."""
    margin = (_window_reach(sigma) + 1) * CELL
    spans = []
    for axis, s, length in ((nodes.x, part[1], nodes.shape[1]), (nodes.y, part[0], nodes.shape[0])):
        first = max(int(axis[s.start]) - margin, 0) // CELL * CELL
        spans.append((first, min(int(axis[s.stop - 1]) + margin, length)))
    (c0, c1), (r0, r1) = spans
    near = nodes.x[part[1]], nodes.y[part[0]]
    x, y = (np.linspace(a[0], a[-1], density * (a.size - 1) + 1) for a in near)
    local = Nodes(x - c0, y - r0, (r1 - r0, c1 - c0), 1)
    return local, images if local.shape == nodes.shape else [i.crop(r0, r1, c0, c1) for i in images]


def grid(length: int, spacing: float) -> ndarray:
    """Positions `spacing` px apart, as many as fit into `length`, centred; at least two."""
    n = int(length // spacing)
    if n < 2:
        raise ValueError(
            f"spacing must leave two vectors along {length} px, thus be at most {length // 2} px;"
            f" got {spacing:g}"
        )
    return (length - 1 - (n - 1) * spacing) / 2 + spacing * np.arange(n)


def vector_axes(shape: tuple[int, int], spacing: float) -> tuple[ndarray, ndarray]:
    """x and y (px, y up, ascending) of the vectors of images of `shape`."""
    x, rows = (grid(length, spacing) for length in shape[::-1])
    return x, shape[0] - 1 - rows[::-1]


@lru_cache(4)
def nodes_of(shape: tuple[int, int], options: Options) -> tuple[Nodes, Nodes, tuple[slice, slice]]:
    """The nodes at half and full resolution, and the slices (rows, columns) of requested vectors.

    Nodes lie at most a quarter of the window apart, because they deform the images.
    All pairs of a recording share them and the weights that they hold.
    """
    k = int(np.ceil(options.spacing / max(options.window / 4, 1)))
    axes, keep = [], []
    for length in (shape[1], shape[0]):
        requested = grid(length, options.spacing)
        if k > 1:
            step = options.spacing / k
            before = int((requested[0] + 0.5) // step)
            count = (
                before + (requested.size - 1) * k + 1 + int((length - 0.5 - requested[-1]) // step)
            )
            axes.append(requested[0] + step * (np.arange(count) - before))
            keep.append(slice(before, before + (requested.size - 1) * k + 1, k))
        else:
            axes.append(requested)
            keep.append(slice(None))
    x, y = axes
    return Nodes(x, y, (shape[0] // 2, shape[1] // 2), 2), Nodes(x, y, shape, 1), (keep[1], keep[0])
