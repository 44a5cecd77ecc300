"""Ensemble correlation: one mean field from the summed correlations of many pairs."""

from collections.abc import Callable, Iterable
from functools import reduce
from operator import iadd
from typing import Any, Unpack

import numpy as np
import xarray as xr
from tqdm import tqdm

from piv.correlation import passes, prefilter
from piv.correlation.deform import Nodes
from piv.correlation.options import Options, OptionWords, with_options
from piv.correlation.pair import (
    both_seen,
    nodes_of,
    pair_cells,
    pair_maps,
    pair_powers,
    run_passes,
    to_dataset,
)
from piv.correlation.pair_images import Prepared
from piv.correlation.uncertainty import errors_of

Pair = tuple[Any, Any, Any]  # images and mask, as of correlate_pair


@with_options
def correlate_ensemble(
    load: Callable[[int], Pair], count: int, *, quiet: bool = True, **options: Unpack[OptionWords]
) -> xr.Dataset:
    """Mean displacement of `count` pairs in px: correlations are summed before peaks are sought.

    load(i): pair i as (a, b, mask); it is called once per pass, so that one pair is in memory.
    Other arguments and the result: as of `correlate_pair`. For repeated flows, or a steady one with
    too few particles for one pair (Meinhart et al. 2000).
    """
    if count < 1:
        raise ValueError("an ensemble needs at least one pair")
    settings = Options(**options)
    if settings.method != "correlation":
        raise ValueError("the ensemble correlates; method must be 'correlation'")

    def prepared(i: int) -> Prepared:
        a, b, mask = load(i)
        return Prepared([a, b], mask, settings.window)

    first = prepared(0)
    shape = first.shape
    half, nodes, keep = nodes_of(shape, settings)
    steps = 2 + settings.half_steps + settings.full_steps + settings.spectra
    bar = tqdm(total=steps * count, unit="pair", desc="ensemble", disable=quiet or None)

    def each() -> Iterable[Prepared]:
        for i in range(count):
            images = prepared(i)
            if images.shape != shape:
                raise ValueError(f"pair {i + 1} is of shape {images.shape}, the first of {shape}")
            yield images
            bar.update()

    def maps_of(*where: Any) -> np.ndarray:
        return reduce(iadd, (pair_maps(images, *where) for images in each()))

    def cells_of(*where: Any) -> np.ndarray:
        return reduce(iadd, (pair_cells(images, *where) for images in each()))

    def spectra_of(*where: Any) -> tuple | None:
        return prefilter.radial_spectra(
            [p for images in each() for p in pair_powers(images, *where)]
        )

    def reseed(nodes: Nodes, vectors: passes.Displacements) -> passes.Displacements:
        return passes.reseed(nodes, first.pixels, vectors, settings)

    seen = both_seen(first.half[1])
    vectors = run_passes(half, nodes, seen, settings, maps_of, cells_of, spectra_of, reseed)
    bar.close()
    # the share of usable pixels is that of all pairs together
    return to_dataset(vectors, errors_of(nodes, vectors, settings), nodes, keep, settings)
