"""Passes of the correlation: FFT at half resolution, then Newton steps at half and full."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import ClassVar

import cv2
import numpy as np
import xarray as xr
from numpy import ndarray

from piv.correlation import fft_pass, prefilter
from piv.correlation.deform import Image, Nodes, spline_value
from piv.correlation.interpolate import bilinear
from piv.correlation.newton_step import newton_step
from piv.correlation.options import Options, grid
from piv.formats.plane_series import provenance
from piv.validation.outliers import fill_absent, normalised_median

_FFT_WINDOWS = (64, 32)  # at half resolution
_FFT_SPACING = 0.75  # of the size of these windows, which only need to find whole pixels
NEAR = 0.75  # side over the largest window's: smaller windows are tested against 3 x 3 neighbours
_RESEED = 32  # px: side of the windows in which outliers are searched again


@dataclass(frozen=True, eq=False)
class Displacements:
    """Displacements at the nodes (px, image axes), their tests and the sums they come from."""

    dx: ndarray
    dy: ndarray
    known: ndarray  # bool: passed every test
    masked: ndarray  # bool: too little of the window could be used
    second: ndarray  # bool: taken from the second correlation peak
    correlation: ndarray
    step_x: ndarray
    step_y: ndarray
    cells: ndarray
    sums: ndarray
    visible: ndarray  # share of the window's weight that could be used
    # variance of noise in 3 x 3 cells over nine times that of one (prefilter.cell_noise)
    cell_noise: float = 1.15
    # side of the window over the largest (piv.correlation.adaptive_windows)
    ratio: ndarray | None = None
    steep: ndarray | None = None  # bool: measured by piv.correlation.steep_regions

    TESTED: ClassVar = ("dx", "dy", "known", "correlation", "step_x", "step_y", "visible")

    @property
    def near(self) -> ndarray | None:
        """Vectors (bool) of small windows, to be tested against the nearest neighbours only."""
        return None if self.ratio is None else self.ratio < NEAR


def vector_dataset(fields: dict[str, ndarray], x, y, height: int, options: Options) -> xr.Dataset:
    """Fields at columns `x`, rows `y` (px) of images `height` px high, as a dataset with y up."""
    fields = fields | {n: fields[n].astype(np.uint8) for n in ("valid", "flag")}
    units = {"valid": "1", "flag": "1", "correlation": "1"}
    return xr.Dataset(
        {n: (("y", "x"), f[::-1].copy(), {"units": units.get(n, "px")}) for n, f in fields.items()},
        coords={
            "x": ("x", x.copy(), {"units": "px"}),
            "y": ("y", (height - 1 - y)[::-1].copy(), {"units": "px"}),
        },
        attrs={"source": "piv", **provenance(**asdict(options))},
    )


def _resample(x, y, field: ndarray, new_x, new_y) -> ndarray:
    """Bilinear values of a grid at new coordinates, held constant outside."""
    i, j = (np.interp(new, old, np.arange(old.size)) for new, old in ((new_x, x), (new_y, y)))
    return bilinear(field, i, j)


def first_passes(
    maps_of: Callable[..., ndarray], shape: tuple[int, int], seen: ndarray | None, search: int, x, y
) -> tuple[ndarray, ndarray]:
    """Displacement (full px) at the nodes (x, y) from FFT passes on half-resolution images.

    maps_of(columns, rows, shift_x, shift_y, size): correlation maps of windows; seen: unmasked
    pixels (half resolution).
    """
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
        maps = maps_of(columns, rows, shift_x, shift_y, size)
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
    return 2 * _resample(*at, dx, x, y), 2 * _resample(*at, dy, x, y)


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


def measure(
    nodes: Nodes,
    cells: ndarray,
    window_sums: tuple,
    dx,
    dy,
    options: Options,
    epsilon: float,
    near: ndarray | None = None,
) -> Displacements:
    """One Newton step from the predictor (dx, dy), and the tests of its result.

    window_sums: of the cells, and of the weights of whole windows; near: as of `deviates`.
    """
    sums, full = window_sums
    step_x, step_y, correlation = newton_step(sums, 1.0)
    new_x = spline_value(dx) + step_x * nodes.factor
    new_y = spline_value(dy) + step_y * nodes.factor
    masked = sums[8] < (1 - options.max_masked) * full
    usable = ~masked & (correlation > options.min_correlation)
    known = usable & ~deviates(new_x, new_y, usable, epsilon, options, near)
    no = np.zeros(known.shape, bool)
    seen = sums[8] / full
    return Displacements(
        new_x, new_y, known, masked, no, correlation, step_x, step_y, cells, sums, seen
    )


def deviates(
    dx, dy, usable: ndarray, epsilon: float, options: Options, near: ndarray | None
) -> ndarray:
    """Vectors (bool) that fail the normalised median test; usable: possible neighbours.

    5 x 5 neighbours; of vectors (bool) marked `near` 3 x 3, since farther neighbours may lie in the
    next wave.
    """
    threshold = options.threshold

    def failed(radius: int) -> ndarray:
        test = normalised_median(
            dx, dy, usable, epsilon=epsilon, radius=radius, threshold=threshold
        )
        return test[0] > threshold

    if near is None or near.all():
        return failed(2 if near is None else 1)
    return np.where(near, failed(1), failed(2))


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
