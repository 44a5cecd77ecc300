"""Displacement field of a pair of particle images; piv.sequence has multi-frame sets and ensembles.

FFT passes at half resolution find the displacement to a few tenths of a pixel. Then both images are
warped half-way towards each other along this displacement, and Newton steps on their windowed
correlation, which need no FFT, find the residual displacement. Before the first step at full
resolution the spectra of signal and noise of the warped images give each frequency its
maximum-likelihood weight. Method and sources: docs/piv_theory.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any, Unpack

import numpy as np
import xarray as xr
from numpy import ndarray
from scipy.ndimage import gaussian_filter

from piv.correlation.adaptive_windows import adapt_windows
from piv.correlation.fft_pass import window_maps
from piv.correlation.newton_step import Displacements
from piv.correlation.nodes import Nodes, nodes_of
from piv.correlation.options import Options, OptionWords, with_options
from piv.correlation.pair_images import Prepared, image_buffers
from piv.correlation.passes import reseed, run_passes, strip_spectra
from piv.correlation.prefilter import Kernel, Powers
from piv.correlation.steep_regions import measure_steep_regions
from piv.correlation.uncertainty import INTERPOLATION, Errors, unseen
from piv.formats.plane_series import (
    FLAGS,
    MASKED,
    OUTLIER,
    REPLACED,
    SECOND_PEAK,
    UNCERTAIN,
    VALID,
    provenance,
)
from piv.validation.denoise import damp_noise
from piv.validation.outliers import RARE, fill_absent, supported

__all__ = ["FLAGS", "Options", "correlate_pair"]

_VAGUE = 1.0  # px: with a larger standard uncertainty a vector is not known at all
# of the vectors that are not masked: with fewer valid ones other ways are tried, and one that makes
# so many valid, uncertain ones counted half, is enough
_ENOUGH = 0.5
_CHANCE = 0.2  # with fewer, an uncertain vector may be anything
# where the first way was enough, another one is better that makes so many more vectors valid: those
# that light at rest made uncertain become valid, those of turbulence stay uncertain
_BETTER = 0.3
# of the correlation that noise leaves a window: an uncertain vector that has less is one of chance
_LEAST_OF_EXPECTED = 0.5
_NEAR, _FEW = 3.0, 0.02  # vectors; share of known ones about a vector that weighs as the picture


@with_options
def correlate_pair(
    a: Any, b: Any, *, mask: Any = None, **options: Unpack[OptionWords]
) -> xr.Dataset:
    """Measure the displacement from image `a` to image `b` on a regular grid of vectors.

    Parameters
    ----------
    a, b
        Grey values (row, column) of any real kind, row 0 at the top.
    mask
        (row, column), true = body; one for both, or (mask_a, mask_b).
    options
        Fields of `Options`.

    Returns
    -------
    xarray.Dataset
        Over x (px right of the centre of the left column) and y (px up from the centre of the
        bottom row): u, v (px per frame interval, v upward, NaN where absent), valid (0 also where a
        known vector is uncertain), flag, u_std, v_std (standard uncertainty), correlation.

    Raises
    ------
    ValueError
        Where the images cannot be correlated, or an option is out of its range.
    TypeError
        For an unknown option, with the nearest spelling.

    Examples
    --------
    >>> with piv.open_recording("docs/tutorials/frames") as film:
    ...     field = piv.correlate_pair(film.frame(0), film.frame(1), window=24, spacing=12)
    >>> sorted(field.data_vars)
    ['correlation', 'flag', 'u', 'u_std', 'v', 'v_std', 'valid']
    """
    settings = Options(**options)

    def correlate(a: Any, b: Any, settings: Options) -> xr.Dataset:
        with image_buffers(np.shape(a)) as new:
            return _correlate(Pair([a, b], mask, settings, new), settings)

    return _best_way(a, b, settings, correlate)


def _correlate(images: Pair, settings: Options) -> xr.Dataset:
    """Correlate prepared images as `correlate_pair` does."""
    half, nodes, keep = nodes_of(images.shape, settings)
    full = images.images(1)
    vectors = run_passes(images, half, nodes, settings)
    vectors, errors = adapt_windows(nodes, full, vectors, settings)
    vectors = measure_steep_regions(nodes, full, vectors, settings, final=True)
    return to_dataset(vectors, errors.in_small_window(vectors), nodes, keep, settings)


class Pair(Prepared):
    """Two images and what the passes need of them (piv.correlation.passes.Images)."""

    def maps(self, columns, rows, shift_x, shift_y, size: int) -> ndarray:
        a, b = self.half
        return window_maps(a, b, columns, rows, shift_x, shift_y, size)

    def cells(self, nodes: Nodes, kernel: Kernel, dx, dy) -> ndarray:
        a, b = self.images(nodes.factor)
        a.filter(kernel)
        b.filter(kernel)
        return nodes.moments(a, b, dx, dy)

    def powers(self, nodes: Nodes, kernel: Kernel, dx, dy) -> list[Powers]:
        moves = [(dx, dy, -0.5), (dx, dy, 0.5)]
        return strip_spectra(nodes, self.images(1), moves, self.common(1), kernel)

    def search_again(self, nodes: Nodes, vectors: Displacements) -> Displacements:
        vectors = reseed(nodes, self.pixels, vectors, self.options)
        return measure_steep_regions(nodes, self.images(1), vectors, self.options)


def to_dataset(
    v: Displacements, errors: Errors, nodes: Nodes, keep: tuple[slice, slice], options: Options
) -> xr.Dataset:
    """Smoothed and flagged vectors, those of the nodes to `keep`, as a dataset with y upward."""
    dx, dy, spacing = v.dx, v.dy, float(nodes.x[1] - nodes.x[0])
    doubtful, across = 2 * v.least, 2 * round(1.125 * options.window / spacing) + 1
    known = supported(v.known, v.masked, v.correlation, doubtful=doubtful, across=across)
    var_x, var_y = errors.var_x, errors.var_y
    below = unseen(nodes, v, np.stack([var_x, var_y]), options)
    if options.smoothing:
        dx, dy, var_x, var_y = damp_noise(
            dx, dy, var_x, var_y, known,
            sigma=options.sigma, spacing=spacing, passes=options.full_steps, ratio=v.ratio,
        )  # fmt: skip
    missed = below + np.stack([errors.missed_x, errors.missed_y])
    std_x, std_y = np.sqrt(np.stack([var_x, var_y]) + missed + INTERPOLATION**2)
    worst = np.maximum(std_x, std_y)
    above = known & (worst > options.max_std)
    if v.steep is not None:
        # up to there it is only an upper bound (Errors.in_small_window)
        above &= ~v.steep | (worst > _VAGUE)
    if above.any():
        known = supported(known & ~above, v.masked, v.correlation, doubtful=doubtful, across=across)
    uncertain = above & (worst < _VAGUE)
    if (known | uncertain).sum() < RARE * (~v.masked).sum():
        uncertain &= v.correlation > doubtful
    uncertain &= v.correlation >= _LEAST_OF_EXPECTED * _expected_correlation(v, known, uncertain)
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
    fields |= {n: fields[n].astype(np.uint8) for n in ("valid", "flag")}
    units = {"valid": "1", "flag": "1", "correlation": "1"}
    out = xr.Dataset(
        {n: (("y", "x"), f[::-1].copy(), {"units": units.get(n, "px")}) for n, f in fields.items()},
        coords={
            "x": ("x", nodes.x[columns].copy(), {"units": "px"}),
            "y": ("y", (nodes.shape[0] - 1 - nodes.y[rows])[::-1].copy(), {"units": "px"}),
        },
        attrs={"source": "piv", **provenance(**asdict(options))},
    )
    out["flag"].attrs["meanings"] = "; ".join(f"{k} {name}" for k, name in enumerate(FLAGS))
    return out


def _expected_correlation(v: Displacements, known: ndarray, uncertain: ndarray) -> ndarray:
    """Correlation of each window, had it the noise of the windows of `known` vectors near it.

    The power that the images do not share there is the noise; far from any, that of the picture's
    median. Windows of few particles in it correlate little where they are right.
    """
    measured = known if known.any() else uncertain
    if not measured.any():
        return np.zeros_like(v.correlation)
    power = np.sqrt(np.maximum(v.sums[5] * v.sums[6], 0))
    apart = np.where(measured, (1 - v.correlation) * power, 0.0)
    near, count = (gaussian_filter(f, _NEAR) for f in (apart, measured.astype(float)))
    noise = (near + _FEW * np.median(apart[measured])) / (count + _FEW)
    return 1 - np.divide(noise, power, out=np.ones_like(power), where=power > 0)


def _best_way(
    a: Any, b: Any, options: Options, correlate: Callable[[Any, Any, Options], xr.Dataset]
) -> xr.Dataset:
    """Correlate, and where less than half of the vectors are valid, try other ways in turn.

    Ways: without what stands still in the pair (the lesser of both grey values), a smaller and a
    larger search. Attribute `retried` names the way that was taken. Uncertain vectors are rejected
    where no way explains enough, and the first hardly anything. A larger window is no way: where it
    holds few particles, too, one valid vector in twenty was wrong.
    """
    field = correlate(a, b, options)
    valid = _share(field, VALID, SECOND_PEAK)
    if valid >= _ENOUGH:
        return field
    least = valid + _BETTER if _explained(field) >= _ENOUGH else 0.0
    still = np.minimum(np.asarray(a, np.float32), np.asarray(b, np.float32))
    ways: dict[str, tuple[Any, Any, Options]] = {
        "background from the pair": (a - still, b - still, options),
    }
    for search in (options.search // 2, 2 * options.search):
        if 16 <= search <= 1024:
            ways[f"search {search} px"] = a, b, replace(options, search=search)
    for name, way in ways.items():
        try:
            other = correlate(*way)
        except ValueError:  # nothing moves in the pair
            continue
        if _explained(other) >= _ENOUGH and _share(other, VALID, SECOND_PEAK) >= least:
            return other.assign_attrs(retried=name)
    if _explained(field) < _CHANCE:
        field = _without_uncertain(field)
    return field


def _explained(field: xr.Dataset) -> float:
    """Share of valid vectors among those that are not masked; uncertain ones count half."""
    return _share(field, VALID, SECOND_PEAK) + 0.5 * _share(field, UNCERTAIN)


def _share(field: xr.Dataset, *flags: int) -> float:
    flag = field["flag"].values
    return float(np.isin(flag, flags).sum() / max((flag != MASKED).sum(), 1))


def _without_uncertain(field: xr.Dataset) -> xr.Dataset:
    unsure = field["flag"] == UNCERTAIN
    kept = {n: field[n].where(~unsure) for n in ("u", "v", "u_std", "v_std")}
    kept["flag"] = field["flag"].where(~unsure, OUTLIER).astype(np.uint8)
    return field.assign(kept)
