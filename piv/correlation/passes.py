"""Passes of the correlation: FFT at half resolution, then Newton steps at half and full."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import cv2
import numpy as np
from numpy import ndarray

from piv.correlation import fft_pass, prefilter
from piv.correlation.newton_step import Displacements, measure
from piv.correlation.nodes import Nodes, bilinear, grid
from piv.correlation.options import Options
from piv.correlation.pair_images import Image
from piv.validation.outliers import fill_absent, normalised_median

_FFT_WINDOWS = (64, 32)  # at half resolution
_FFT_SPACING = 0.75  # of the size of these windows, which only need to find whole pixels
_RESEED = 32  # px: side of the windows in which outliers are searched again


def _resample(x, y, field: ndarray, new_x, new_y) -> ndarray:
    """Bilinear values of a grid at new coordinates, held constant outside."""
    i, j = (np.interp(new, old, np.arange(old.size)) for new, old in ((new_x, x), (new_y, y)))
    return bilinear(field, i, j)


class Images(Protocol):
    """What is correlated: a pair, a set of frames or an ensemble, at half and full resolution."""

    shape: tuple[int, int]

    def common(self, factor: int) -> ndarray | None:
        """Pixels (bool) that no image masks, at half resolution (2); None: all."""

    def maps(self, columns, rows, shift_x, shift_y, size: int) -> ndarray:
        """Correlation maps of windows at half resolution (fft_pass.window_maps)."""
        ...

    def cells(self, nodes: Nodes, kernel: prefilter.Kernel, dx, dy) -> ndarray:
        """Products per cell of the filtered images, warped along (dx, dy) (Nodes.moments)."""
        ...

    def powers(self, nodes: Nodes, kernel: prefilter.Kernel, dx, dy) -> list[prefilter.Powers]:
        """Cross and difference powers of the filtered images, warped along (dx, dy)."""
        ...

    def search_again(self, nodes: Nodes, vectors: Displacements) -> Displacements:
        """Put other predictors in place of outliers, before the next step."""
        ...


def run_passes(images: Images, half: Nodes, nodes: Nodes, options: Options) -> Displacements:
    """Measure displacements at `nodes` (px, image axes) in all passes, those of `half` first."""
    dx, dy = first_passes(images, half, options.search)
    weights, usual = prefilter.default_filter(), options.min_correlation
    for _ in range(options.half_steps):
        cells = images.cells(half, weights.kernel, dx, dy)
        sums = half.window_sums(cells, 1.2 * options.sigma)
        vectors = measure(half, cells, sums, dx, dy, options, max(options.epsilon, 0.5))
        dx, dy = fill_absent(vectors.dx, vectors.dy, vectors.known)
    second = np.zeros(dx.shape, bool)
    for step in range(options.full_steps):
        if step < options.spectra:
            powers = images.powers(nodes, weights.kernel, dx, dy)
            weights = prefilter.best_filter(powers, weights)
            least = weights.least_correlation(options.sigma, usual)
            options = replace(options, min_correlation=least)
        cells = images.cells(nodes, weights.kernel, dx, dy)
        sums = nodes.window_sums(cells, options.sigma)
        vectors = measure(nodes, cells, sums, dx, dy, options, options.epsilon)
        if step == options.full_steps - 1:
            break
        vectors = images.search_again(nodes, vectors)
        second |= vectors.second
        dx, dy = vectors.dx, vectors.dy
    vectors.second[:] = second & vectors.known
    return replace(vectors, cell_noise=weights.cell_noise, least=options.min_correlation)


def first_passes(images: Images, half: Nodes, search: int) -> tuple[ndarray, ndarray]:
    """Measure the displacement (full px) at the nodes by FFT at half resolution."""
    shape, seen = half.shape, images.common(2)
    largest = min(max(search // 2, 16), *shape)
    sizes = sorted(
        (s for s in {min(search // 2, 512), *_FFT_WINDOWS} if s <= largest), reverse=True
    ) or [16]
    gx = gy = np.zeros(0, np.int64)
    dx = dy = np.zeros((0, 0), np.float32)
    for size in sizes:
        step = _FFT_SPACING * size
        cy, cx = (
            np.unique(np.rint(grid(length, min(step, length / 2))).astype(np.int64))
            for length in shape
        )
        columns, rows = (m.ravel() for m in np.meshgrid(cx, cy))
        if not dx.size:
            shift_x = shift_y = np.zeros(columns.size, np.int64)
        else:
            shift_x, shift_y = (
                np.rint(_resample(gx, gy, d, cx, cy)).astype(np.int64).ravel() for d in (dx, dy)
            )
        reach = size // 4 if dx.size else 3 * size // 8
        maps = images.maps(columns, rows, shift_x, shift_y, size)
        peaks = fft_pass.find_peaks(maps, shift_x, shift_y, reach)
        grid_shape = (cy.size, cx.size)
        dx, dy, sx, sy = (p.reshape(grid_shape) for p in peaks)
        usable = np.ones(grid_shape, bool)
        if seen is not None:
            usable = cv2.blur(seen.astype(np.float32), (size, size))[np.ix_(cy, cx)] > 0.4
        residual, median_x, median_y = normalised_median(dx, dy, usable, epsilon=0.3)
        bad = residual > 3
        nearer = bad & (
            np.hypot(sx - median_x, sy - median_y) < 0.5 * np.hypot(dx - median_x, dy - median_y)
        )
        dx, dy = np.where(nearer, sx, dx), np.where(nearer, sy, dy)
        residual, _, _ = normalised_median(dx, dy, usable, epsilon=0.3)
        dx, dy = fill_absent(dx, dy, usable & ~(residual > 3))
        gx, gy = cx, cy
    at = 2 * gx + 0.5, 2 * gy + 0.5
    return 2 * _resample(*at, dx, half.x, half.y), 2 * _resample(*at, dy, half.x, half.y)


# dx, dy at the nodes and the share of them by which an image is warped
_Move = tuple[ndarray, ndarray, float]


def strip_spectra(
    nodes: Nodes,
    images: list[Image],
    moves: list[_Move],
    seen: ndarray | None,
    kernel: prefilter.Kernel,
) -> list[prefilter.Powers]:
    """Cross and difference power of strips of two images, filtered and warped by their moves.

    Strips are enough for the spectra and cost a seventh of a pass over the whole image.
    """
    spectra = []
    field = np.empty((3, prefilter.TILE, nodes.shape[1]), np.float32)
    for first in prefilter.tile_rows(*nodes.shape, seen):
        parts = []
        for k, (image, (dx, dy, share)) in enumerate(zip(images, moves, strict=True)):
            nodes.dense(dx, field[0], first)
            nodes.dense(dy, field[1], first)
            reach = int(np.abs(share * field[1]).max()) + 3
            image.filter_rows(kernel, first - reach, first + prefilter.TILE + reach)
            parts.append(image.warp(field[0], field[1], share, field[2], k > 0, first))
        powers = prefilter.strip_powers(parts[0], parts[1], field[2])
        spectra += [] if powers is None else [powers]
    return spectra


def reseed(
    nodes: Nodes, pixels: list[ndarray], vectors: Displacements, options: Options
) -> Displacements:
    """Outliers searched again near their neighbours' displacement, at two correlation peaks."""
    lost = ~vectors.known & ~vectors.masked
    dx, dy = fill_absent(vectors.dx, vectors.dy, vectors.known)
    second = np.zeros(lost.shape, bool)
    j, i = np.nonzero(lost)
    if j.size and vectors.known.any():
        column, row = (
            np.rint(nodes.column[i]).astype(np.int64),
            np.rint(nodes.row[j]).astype(np.int64),
        )
        shift_x, shift_y = np.rint(dx[j, i]).astype(np.int64), np.rint(dy[j, i]).astype(np.int64)
        maps = fft_pass.window_maps(pixels[0], pixels[1], column, row, shift_x, shift_y, _RESEED)
        peaks = fft_pass.find_peaks(maps, shift_x, shift_y, _RESEED // 4)
        first = np.hypot(peaks.dx - dx[j, i], peaks.dy - dy[j, i])
        other = np.hypot(peaks.second_x - dx[j, i], peaks.second_y - dy[j, i])
        near = 1.5  # px: reach of a Newton step; beyond it the neighbours are the better predictor
        take_first, take_second = first < near, (other < near) & ~(first < near)
        dx[j, i] = np.select([take_first, take_second], [peaks.dx, peaks.second_x], dx[j, i])
        dy[j, i] = np.select([take_first, take_second], [peaks.dy, peaks.second_y], dy[j, i])
        second[j, i] = take_second
    return replace(vectors, dx=dx, dy=dy, second=second)
