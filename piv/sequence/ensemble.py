"""Ensemble correlation: one mean field from the summed correlations of many pairs."""

from collections.abc import Callable, Iterable, Sequence
from functools import reduce
from operator import iadd
from typing import Any, Unpack

import numpy as np
import xarray as xr
from tqdm import tqdm

from piv.correlation.newton_step import Displacements
from piv.correlation.nodes import Nodes, nodes_of
from piv.correlation.options import Options, OptionWords, with_options
from piv.correlation.pair import Pair, to_dataset
from piv.correlation.passes import reseed, run_passes
from piv.correlation.prefilter import Powers
from piv.correlation.uncertainty import errors_of

Images = tuple[Any, ...]  # two images, and perhaps a mask, as of correlate_pair


@with_options
def correlate_ensemble(
    pairs: Sequence[Images] | Callable[[int], Images],
    count: int | None = None,
    *,
    quiet: bool = True,
    **options: Unpack[OptionWords],
) -> xr.Dataset:
    """Measure the mean displacement of many pairs: correlations are summed before peaks are sought.

    For repeated flows, or a steady one with too few particles for one pair (Meinhart et al. 2000).

    Parameters
    ----------
    pairs
        A list of (a, b) or (a, b, mask), as of `correlate_pair`; or a function that gives pair i,
        which is called once per pass, so that one pair is in memory.
    count
        Number of pairs that a function gives.
    quiet
        Whether no bar of progress is shown.
    options
        Fields of `Options`.

    Returns
    -------
    xarray.Dataset
        As of `correlate_pair`.

    Raises
    ------
    ValueError
        Without a pair, or where pairs differ in shape.
    TypeError
        For an unknown option, with the nearest spelling.

    Examples
    --------
    >>> with piv.open_recording("docs/tutorials/frames") as film:
    ...     images = list(film)
    >>> mean = piv.correlate_ensemble(list(zip(images[:-1], images[1:])), window=24, spacing=12)
    >>> mean["u"].dims
    ('y', 'x')
    """
    if callable(pairs):
        load = pairs
    else:
        load, count = pairs.__getitem__, len(pairs)
    if not count or count < 1:
        raise ValueError("an ensemble needs at least one pair, and their `count` if it loads them")
    settings = Options(**options)
    images = _Ensemble(load, count, settings, quiet)
    half, nodes, keep = nodes_of(images.shape, settings)
    vectors = run_passes(images, half, nodes, settings)
    images.bar.close()
    # the share of usable pixels is that of all pairs together
    return to_dataset(vectors, errors_of(nodes, vectors, settings), nodes, keep, settings)


class _Ensemble:
    """Pairs whose correlations are summed (piv.correlation.passes.Images)."""

    def __init__(self, load: Callable[[int], Images], count: int, options: Options, quiet: bool):
        self.load, self.count, self.options = load, count, options
        self.first = self._pair(0)
        self.shape = self.first.shape
        passes = 2 + options.half_steps + options.full_steps + options.spectra
        total, silent = passes * count, quiet or None
        self.bar = tqdm(total=total, unit="pair", desc="ensemble", disable=silent)

    def _pair(self, i: int) -> Pair:
        a, b, mask = (*self.load(i), None)[:3]
        return Pair([a, b], mask, self.options)

    def _each(self) -> Iterable[Pair]:
        for i in range(self.count):
            pair = self._pair(i)
            if pair.shape != self.shape:
                raise ValueError(
                    f"pair {i + 1} is of shape {pair.shape}, the first of {self.shape}"
                )
            yield pair
            self.bar.update()

    def common(self, factor: int) -> np.ndarray | None:
        return self.first.common(factor)

    def maps(self, *where: Any) -> np.ndarray:
        return reduce(iadd, (pair.maps(*where) for pair in self._each()))

    def cells(self, *where: Any) -> np.ndarray:
        return reduce(iadd, (pair.cells(*where) for pair in self._each()))

    def powers(self, *where: Any) -> list[Powers]:
        return [p for pair in self._each() for p in pair.powers(*where)]

    def search_again(self, nodes: Nodes, vectors: Displacements) -> Displacements:
        return reseed(nodes, self.first.pixels, vectors, self.options)
