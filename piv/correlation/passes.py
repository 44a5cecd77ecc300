"""The passes of the correlation: FFT at half resolution, Newton steps at half, then at full resolution."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from piv.correlation import fft_pass, prefilter
from piv.correlation import newton_step as refine
from piv.correlation.deform import Image, Nodes, spline_value
from piv.correlation.options import Options
from piv.validation.outliers import fill_absent, normalised_median

FFT_WINDOWS = (64, 32)  # at half resolution
FFT_SPACING = 0.75  # of their windows, as a part of their size: they need find whole pixels only
NARROW = 0.5  # of the window, where the flow is too fine for it
RESEED = 32  # px: windows of the search where a vector is an outlier


@dataclass(frozen=True, eq=False)
class Vectors:
    """Vectors at the nodes (px, image axes) and what is known of them."""

    dx: np.ndarray
    dy: np.ndarray
    known: np.ndarray  # bool: passed every test
    masked: np.ndarray  # bool: too little of the window could be used
    second: np.ndarray  # bool: the second peak of the correlation led to it
    correlation: np.ndarray
    step_x: np.ndarray
    step_y: np.ndarray
    cells: np.ndarray
    sums: np.ndarray
    visible: np.ndarray  # share of the window's weight that could be used
    fine: np.ndarray | None = (
        None  # bool: measured in a window NARROW times as wide (piv.correlation.small_windows)
    )
    narrow: np.ndarray | None = (
        None  # bool: replaced by piv.correlation.steep_regions, from such a window too
    )

    def replaced(self, where: np.ndarray, other: Vectors) -> Vectors:
        """These vectors and their tests, but the `other` ones at `where`; cells and sums stay."""
        names = ("dx", "dy", "known", "correlation", "step_x", "step_y", "visible")
        chosen = {n: np.where(where, getattr(other, n), getattr(self, n)) for n in names}
        return replace(self, **chosen, second=self.second & ~where, fine=where)


def grid(length: int, spacing: float) -> np.ndarray:
    """Positions `spacing` px apart, as many as fit, centred."""
    n = max(int(length // spacing), 2)
    return (length - 1 - (n - 1) * spacing) / 2 + spacing * np.arange(n)


def resample(x, y, field: np.ndarray, new_x, new_y) -> np.ndarray:
    """Bilinear values of a grid at new coordinates, held constant outside."""
    i = np.interp(new_x, x, np.arange(x.size)).astype(np.float32)
    j = np.interp(new_y, y, np.arange(y.size)).astype(np.float32)
    map_x, map_y = np.meshgrid(i, j)
    return cv2.remap(
        field.astype(np.float32), map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )


def first_passes(
    maps_of: Callable[..., np.ndarray], shape: tuple[int, int], seen: np.ndarray | None, search: int, x, y
) -> tuple[np.ndarray, np.ndarray]:
    """Predictor at the nodes (x, y) (full px) from FFT passes on half-resolution images of `shape`.

    maps_of(columns, rows, shift_x, shift_y, size) gives the correlation maps of windows; seen: where images may
    be used (half resolution).
    """
    sizes = [
        s for s in sorted({min(search // 2, 512), *FFT_WINDOWS}, reverse=True) if s <= max(search // 2, 16)
    ]
    sizes = [s for s in sizes if s <= min(shape)] or [16]
    gx = gy = np.zeros(0, np.int64)
    dx = dy = np.zeros((0, 0), np.float32)
    for size in sizes:
        step = FFT_SPACING * size
        cx = np.unique(np.rint(grid(shape[1], step)).astype(np.int64))
        cy = np.unique(np.rint(grid(shape[0], step)).astype(np.int64))
        columns, rows = (m.ravel() for m in np.meshgrid(cx, cy))
        if not dx.size:
            shift_x = shift_y = np.zeros(columns.size, np.int64)
        else:
            shift_x, shift_y = (
                np.rint(resample(gx, gy, d, cx, cy)).astype(np.int64).ravel() for d in (dx, dy)
            )
        reach = size // 4 if dx.size else 3 * size // 8
        maps = maps_of(columns, rows, shift_x, shift_y, size)
        peaks = fft_pass.find_peaks(maps, shift_x, shift_y, reach)
        grid_shape = (cy.size, cx.size)
        dx, dy, sx, sy = (p.reshape(grid_shape) for p in peaks)
        usable = np.ones(grid_shape, bool)
        if seen is not None:
            usable = cv2.blur(seen.astype(np.float32), (size, size))[np.ix_(cy, cx)] > 0.4
        residual, median_x, median_y = normalised_median(dx, dy, usable, epsilon=0.3)
        bad = residual > 3
        nearer = bad & (np.hypot(sx - median_x, sy - median_y) < 0.5 * np.hypot(dx - median_x, dy - median_y))
        dx, dy = np.where(nearer, sx, dx), np.where(nearer, sy, dy)
        residual, _, _ = normalised_median(dx, dy, usable, epsilon=0.3)
        dx, dy = fill_absent(dx, dy, usable & ~(residual > 3))
        gx, gy = cx, cy
    at = 2 * gx + 0.5, 2 * gy + 0.5
    return 2 * resample(*at, dx, x, y), 2 * resample(*at, dy, x, y)


Move = tuple[np.ndarray, np.ndarray, float]  # vectors dx, dy and the share of them that an image is moved by


def strip_spectra(
    nodes: Nodes,
    images: list[Image],
    moves: list[Move],
    seen: np.ndarray | None,
    kernel: prefilter.Kernel,
) -> list[prefilter.Powers]:
    """Powers of strips of two images, filtered by `kernel` and warped each by its move.

    A part of the image is enough for spectra, and a seventh of a pass.
    """
    found = []
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
        found += [] if powers is None else [powers]
    return found


def measure(
    nodes: Nodes,
    cells: np.ndarray,
    dx,
    dy,
    sigma: float,
    options: Options,
    epsilon: float,
    fine: np.ndarray | None = None,
) -> Vectors:
    """One Newton step from the predictor (dx, dy) that the images of `cells` were warped by, and its tests.

    fine: nodes (bool) that are measured in a window NARROW times as wide.
    """
    sums, full = nodes.window_sums(cells, sigma)
    if fine is not None:
        narrow, part = nodes.window_sums(cells, NARROW * sigma)
        sums, full = np.where(fine, narrow, sums), np.where(fine, part, full)
    step_x, step_y, correlation = refine.newton_step(sums, 1.0)
    new_x = spline_value(dx) + step_x * nodes.factor
    new_y = spline_value(dy) + step_y * nodes.factor
    masked = sums[8] < (1 - options.max_masked) * full
    usable = ~masked & (correlation > options.min_correlation)
    known = usable & ~deviates(new_x, new_y, usable, epsilon, options, fine)
    no = np.zeros(known.shape, bool)
    seen = sums[8] / full
    return Vectors(new_x, new_y, known, masked, no, correlation, step_x, step_y, cells, sums, seen, fine)


def deviates(
    dx, dy, usable: np.ndarray, epsilon: float, options: Options, fine: np.ndarray | None
) -> np.ndarray:
    """Vectors (bool) that fail the normalised-median test; usable: those that serve as neighbours.

    5 x 5 neighbours; for `fine` vectors 3 x 3, as near as their window is narrow: farther ones belong to the next wave.
    """
    threshold = options.threshold
    failed = normalised_median(dx, dy, usable, epsilon=epsilon, radius=2, threshold=threshold)[0] > threshold
    if fine is None:
        return failed
    near = normalised_median(dx, dy, usable, epsilon=epsilon, radius=1, threshold=threshold)[0] > threshold
    return np.where(fine, near, failed)


def reseed(nodes: Nodes, pixels: list[np.ndarray], vectors: Vectors, options: Options) -> Vectors:
    """Outliers searched again in small windows around their neighbours' displacement, first and second peak."""
    lost = ~vectors.known & ~vectors.masked
    dx, dy = fill_absent(vectors.dx, vectors.dy, vectors.known)
    second = np.zeros(lost.shape, bool)
    j, i = np.nonzero(lost)
    if j.size and vectors.known.any():
        column, row = np.rint(nodes.column[i]).astype(np.int64), np.rint(nodes.row[j]).astype(np.int64)
        shift_x, shift_y = np.rint(dx[j, i]).astype(np.int64), np.rint(dy[j, i]).astype(np.int64)
        maps = fft_pass.window_maps(pixels[0], pixels[1], column, row, shift_x, shift_y, RESEED)
        peaks = fft_pass.find_peaks(maps, shift_x, shift_y, RESEED // 4)
        first = np.hypot(peaks.dx - dx[j, i], peaks.dy - dy[j, i])
        other = np.hypot(peaks.second_x - dx[j, i], peaks.second_y - dy[j, i])
        near = 1.5  # px: what a Newton step can still reach; farther off, neighbours are the better predictor
        take_first, take_second = first < near, (other < near) & ~(first < near)
        dx[j, i] = np.select([take_first, take_second], [peaks.dx, peaks.second_x], dx[j, i])
        dy[j, i] = np.select([take_first, take_second], [peaks.dy, peaks.second_y], dy[j, i])
        second[j, i] = take_second
    return replace(vectors, dx=dx, dy=dy, second=second)
