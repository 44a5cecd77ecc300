"""Other ways to correlate a pair whose first result explains too little of the pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from piv.correlation.options import Options
from piv.formats.plane_series import MASKED, OUTLIER, SECOND_PEAK, UNCERTAIN, VALID

_ENOUGH = 0.5  # of the vectors that are not masked, uncertain ones counted half
_CHANCE = 0.2  # with fewer, an uncertain vector may be anything

Correlate = Callable[[Any, Any, Options], xr.Dataset]


def best_of(a: Any, b: Any, options: Options, correlate: Correlate) -> xr.Dataset:
    """The result of `correlate`, or of the first other way that explains enough of the pictures.

    Ways: without what stands still in the pair (the lesser of both grey values), a smaller and a
    larger search. Attribute `retried` names the way that was taken. Uncertain vectors are rejected
    where no way explains enough, and the first hardly anything. A larger window is no way: where it
    holds few particles, too, one valid vector in twenty was wrong.
    """
    field = correlate(a, b, options)
    if _explained(field) >= _ENOUGH:
        return field
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
        if _explained(other) >= _ENOUGH:
            return other.assign_attrs(retried=name)
    if _explained(field) < _CHANCE:
        field = _without_uncertain(field)
    return field


def _explained(field: xr.Dataset) -> float:
    """Share of valid vectors among those that are not masked; uncertain ones count half."""
    flag = field["flag"].values
    good = np.isin(flag, (VALID, SECOND_PEAK)).sum() + 0.5 * (flag == UNCERTAIN).sum()
    return float(good / max((flag != MASKED).sum(), 1))


def _without_uncertain(field: xr.Dataset) -> xr.Dataset:
    unsure = field["flag"] == UNCERTAIN
    kept = {n: field[n].where(~unsure) for n in ("u", "v", "u_std", "v_std")}
    kept["flag"] = field["flag"].where(~unsure, OUTLIER).astype(np.uint8)
    return field.assign(kept)
