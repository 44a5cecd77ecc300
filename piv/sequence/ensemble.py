"""Ensemble correlation: one mean field from the summed correlations of many pairs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict
from functools import reduce
from operator import iadd
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from tqdm import tqdm

from fileio.formats.plane_series import provenance
from fileio.formats.resumable import SeriesWriter
from piv.correlation import passes, prefilter
from piv.correlation.deform import Nodes
from piv.correlation.options import Options
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
from piv.images.preprocess import Preprocessor
from piv.images.recording import Recording
from piv.sequence.sequence import SequenceOptions, SeriesUnits, carried, frame_sets

Pair = tuple[Any, Any, Any]  # images and mask, as of correlate_pair


def correlate_ensemble(
    load: Callable[[int], Pair], count: int, *, quiet: bool = True, **options: Any
) -> xr.Dataset:
    """Mean displacement of `count` pairs in px: correlations are summed over the pairs before peaks are sought.

    load(i) gives pair i as (a, b, mask) and is called once per pass, so that one pair at a time is in memory; the
    other arguments and the result are as of `correlate_pair`. A mean over runs of a repeated flow, or of a steady
    one with too few particles for one pair (Meinhart et al. 2000).
    """
    if count < 1:
        raise ValueError("an ensemble needs at least one pair")
    settings = Options(**options)
    if settings.method != "correlation":
        raise ValueError("the ensemble correlates; method must be 'correlation'")
    first = prepared(load, 0, settings)
    shape = first.shape
    half, nodes, keep = nodes_of(shape, settings)
    steps = 2 + settings.half_steps + settings.full_steps + settings.spectra
    bar = tqdm(total=steps * count, unit="pair", desc="ensemble", disable=quiet or None)

    def each() -> Iterable[Prepared]:
        for i in range(count):
            images = prepared(load, i, settings)
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


def prepared(load: Callable[[int], Pair], index: int, options: Options) -> Prepared:
    """Pair `index` without background."""
    a, b, mask = load(index)
    return Prepared([a, b], mask, options.window)


def correlate_ensemble_to(
    recording: Recording,
    output: str | Path,
    options: Options,
    sequence: SequenceOptions,
    *,
    quiet: bool = True,
) -> Path:
    """The ensemble mean of a recording's pairs as a plane series of one field, at the mean of their times."""
    if sequence.frames != 2:
        raise ValueError("the ensemble is of pairs; leave out --frames")
    sets = frame_sets(len(recording), sequence)
    clean = Preprocessor(sequence.steps, recording)

    def load(i: int) -> Pair:
        a, b = sets[i]
        return (
            clean(recording.frame(a)),
            clean(recording.frame(b)),
            [clean.mask(recording.mask(k)) for k in (a, b)],
        )

    plane = correlate_ensemble(load, len(sets), quiet=quiet, **asdict(options))
    units = SeriesUnits.of(recording, sets)
    if np.ptp(units.interval) > 1e-6 * units.interval[0]:
        raise ValueError(f"{recording.name}: an ensemble needs pairs of equal intervals")
    settings = {**asdict(options), **asdict(sequence), "preprocess": clean.steps, "ensemble": True}
    attrs = {"source": "piv", **provenance(**settings), **carried(recording, None)}
    x, y = units.axes(plane["x"].values, plane["y"].values)
    time = [float(units.time.mean())]
    writer = SeriesWriter(
        output,
        x,
        y,
        time,
        units.names,
        attrs,
        [recording.name, recording.key, settings, "ensemble"],
    )
    try:
        writer.write(0, units.fields(plane, 0))
        return writer.finish()
    finally:
        writer.close()
