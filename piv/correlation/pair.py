"""Displacement field of a pair of particle images; piv.sequence has multi-frame sets and ensembles.

FFT passes at half resolution find the displacement to a few tenths of a pixel. Then both images are
warped half-way towards each other along this displacement, and Newton steps on their windowed
correlation, which need no FFT, find the residual displacement. Before the first step at full
resolution the spectra of signal and noise of the warped images give each frequency its
maximum-likelihood weight. Method and sources: docs/piv_theory.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, Unpack

import numpy as np
import xarray as xr
from numpy import ndarray

from piv.correlation import passes, prefilter
from piv.correlation.adaptive_windows import measure_adapted, separated, window_ratio
from piv.correlation.buffers import image_buffers
from piv.correlation.deform import Nodes
from piv.correlation.fft_pass import window_maps
from piv.correlation.newton_step import CELL
from piv.correlation.options import Options, OptionWords, grid, with_options
from piv.correlation.pair_images import Prepared
from piv.correlation.passes import Displacements, vector_dataset
from piv.correlation.retry import best_of
from piv.correlation.steep_regions import measure_steep_regions
from piv.correlation.uncertainty import INTERPOLATION, Errors, errors_of
from piv.formats.plane_series import (
    FLAGS,
    MASKED,
    OUTLIER,
    REPLACED,
    SECOND_PEAK,
    UNCERTAIN,
    VALID,
)
from piv.validation.denoise import damp_noise
from piv.validation.outliers import RARE, fill_absent, supported

__all__ = ["FLAGS", "Options", "correlate_pair"]

_VAGUE = 1.0  # px: with a larger standard uncertainty a vector is not known at all


@with_options
def correlate_pair(
    a: Any, b: Any, *, mask: Any = None, **options: Unpack[OptionWords]
) -> xr.Dataset:
    """Displacement from image `a` to image `b`, in px, on a regular grid of vectors.

    a, b: 2-D, row 0 at the top, any real dtype; mask: 2-D, true = body, one for both or (mask_a,
    mask_b); options: see piv.correlation.options.Options. The result has coordinates x (px right of
    the centre of the left column), y (px up from the centre of the bottom row), ascending, and u, v
    (px per frame interval, v positive upward; NaN where absent), valid (0 also where a known vector
    is uncertain), flag (FLAGS), u_std, v_std (standard uncertainty), correlation. ValueError where
    the input cannot be used.
    """
    settings = Options(**options)
    if settings.method == "optical_flow":
        from piv.correlation.optical_flow import optical_flow

        return optical_flow(a, b, mask, settings)

    def correlate(a: Any, b: Any, settings: Options) -> xr.Dataset:
        with image_buffers(np.shape(a)) as new:
            return _correlate(Prepared([a, b], mask, settings.window, new), settings)

    return best_of(a, b, settings, correlate)


def _correlate(images: Prepared, settings: Options) -> xr.Dataset:
    """`correlate_pair` of prepared images."""
    full = images.images(1)

    def spectra_of(*where: Any) -> tuple | None:
        return prefilter.radial_spectra(pair_powers(images, *where))

    def reseed(nodes: Nodes, vectors: Displacements) -> Displacements:
        vectors = passes.reseed(nodes, images.pixels, vectors, settings)
        return measure_steep_regions(nodes, full, vectors, settings)

    half, nodes, keep = nodes_of(images.shape, settings)
    maps_of, cells_of = partial(pair_maps, images), partial(pair_cells, images)
    seen = both_seen(images.half[1])
    vectors = run_passes(half, nodes, seen, settings, maps_of, cells_of, spectra_of, reseed)
    errors = errors_of(nodes, vectors, settings)
    errors = separated(nodes, vectors, errors, settings.sigma, settings.full_steps)
    ratio = window_ratio(vectors, errors, settings)
    if (ratio < 1).any():
        vectors, errors = measure_adapted(nodes, full, vectors, errors, ratio, settings)
    vectors = measure_steep_regions(nodes, full, vectors, settings, final=True)
    if vectors.steep is not None:
        errors = errors.in_small_window(vectors.steep & (ratio == 1))
    return to_dataset(vectors, errors, nodes, keep, settings)


def pair_maps(images: Prepared, columns, rows, shift_x, shift_y, size: int) -> ndarray:
    """`window_maps` of a pair at half resolution."""
    half, _ = images.half
    return window_maps(half[0], half[1], columns, rows, shift_x, shift_y, size)


def pair_cells(images: Prepared, nodes: Nodes, kernel: prefilter.Kernel, dx, dy) -> ndarray:
    """`Nodes.moments` of a pair that is filtered by `kernel`."""
    a, b = images.images(nodes.factor)
    a.filter(kernel)
    b.filter(kernel)
    return nodes.moments(a, b, dx, dy)


def pair_powers(
    images: Prepared, nodes: Nodes, kernel: prefilter.Kernel, dx, dy
) -> list[prefilter.Powers]:
    """`strip_spectra` of a pair that is warped half-way along (dx, dy)."""
    moves = [(dx, dy, -0.5), (dx, dy, 0.5)]
    return passes.strip_spectra(nodes, images.images(1), moves, both_seen(images.seen), kernel)


def both_seen(seen: list[ndarray | None]) -> ndarray | None:
    """Pixels (bool) that no image masks; None without masks."""
    masks = [s for s in seen if s is not None]
    return np.logical_and.reduce(masks) if masks else None


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


def run_passes(
    half: Nodes,
    nodes: Nodes,
    seen: ndarray | None,
    options: Options,
    maps_of: Callable[..., ndarray],
    cells_of: Callable[..., ndarray],
    spectra_of: Callable[..., tuple | None],
    reseed: Callable[[Nodes, Displacements], Displacements],
) -> Displacements:
    """All passes; the callbacks hold the images. Displacements at `nodes` in image axes."""
    dx, dy = passes.first_passes(maps_of, half.shape, seen, options.search, half.x, half.y)
    response = prefilter.default_response()
    kernel = prefilter.kernel(response)
    for _ in range(options.half_steps):
        cells = cells_of(half, kernel, dx, dy)
        sums = half.window_sums(cells, 1.2 * options.sigma)
        vectors = passes.measure(half, cells, sums, dx, dy, options, max(options.epsilon, 0.5))
        dx, dy = fill_absent(vectors.dx, vectors.dy, vectors.known)
    second = np.zeros(dx.shape, bool)
    cell_noise = Displacements.cell_noise
    for step in range(options.full_steps):
        if step < options.spectra and (spectra := spectra_of(nodes, kernel, dx, dy)) is not None:
            spectra = prefilter.undo(response, spectra)
            response = prefilter.optimal_response(*spectra)
            kernel = prefilter.kernel(response)
            cell_noise = prefilter.cell_noise(spectra, response, CELL)
        cells = cells_of(nodes, kernel, dx, dy)
        sums = nodes.window_sums(cells, options.sigma)
        vectors = passes.measure(nodes, cells, sums, dx, dy, options, options.epsilon)
        if step == options.full_steps - 1:
            break
        vectors = reseed(nodes, vectors)
        second |= vectors.second
        dx, dy = vectors.dx, vectors.dy
    vectors.second[:] = second & vectors.known
    return replace(vectors, cell_noise=cell_noise)


def to_dataset(
    v: Displacements, errors: Errors, nodes: Nodes, keep: tuple[slice, slice], options: Options
) -> xr.Dataset:
    """Smoothed and flagged vectors, those of the nodes to `keep`, as a dataset with y upward."""
    dx, dy, spacing = v.dx, v.dy, float(nodes.x[1] - nodes.x[0])
    doubtful, across = 2 * options.min_correlation, 2 * round(1.125 * options.window / spacing) + 1
    known = supported(v.known, v.masked, v.correlation, doubtful=doubtful, across=across)
    var_x, var_y = errors.var_x, errors.var_y
    if options.smoothing:
        dx, dy, var_x, var_y = damp_noise(
            dx, dy, var_x, var_y, known,
            sigma=options.sigma, spacing=spacing, passes=options.full_steps, ratio=v.ratio,
        )  # fmt: skip
    std_x, std_y = (
        np.sqrt(var + missed + INTERPOLATION**2)
        for var, missed in ((var_x, errors.missed_x), (var_y, errors.missed_y))
    )
    worst = np.maximum(std_x, std_y)
    above = known & (worst > options.max_std)
    if v.steep is not None:
        above &= ~v.steep | (
            worst > _VAGUE
        )  # up to there it is only an upper bound (Errors.in_small_window)
    if above.any():
        known = supported(known & ~above, v.masked, v.correlation, doubtful=doubtful, across=across)
    uncertain = above & (worst < _VAGUE)
    if (known | uncertain).sum() < RARE * (~v.masked).sum():
        uncertain &= v.correlation > doubtful
    flag = np.full(known.shape, VALID, np.uint8)
    flag[~known] = OUTLIER
    flag[v.second & known] = SECOND_PEAK
    flag[uncertain] = UNCERTAIN
    flag[v.masked] = MASKED
    present = known.copy()
    finite = known | uncertain
    if options.replace and known.any():
        put = ~known & ~v.masked
        dx, dy = fill_absent(dx, dy, known)
        std_x[put] = std_y[put] = np.nan  # a replacement was not measured
        flag[put] = REPLACED
        present |= put
        finite = present
    in_px = {"u": dx, "v": -dy, "u_std": std_x, "v_std": std_y}
    fields = {n: np.where(finite, f, np.nan) for n, f in in_px.items()}
    fields |= {
        "valid": present,
        "flag": flag,
        "correlation": np.where(v.masked, np.nan, v.correlation),
    }
    rows, columns = keep
    fields = {n: f[rows, columns] for n, f in fields.items()}
    out = vector_dataset(fields, nodes.x[columns], nodes.y[rows], nodes.shape[0], options)
    out["flag"].attrs["meanings"] = "; ".join(f"{k} {name}" for k, name in enumerate(FLAGS))
    return out
