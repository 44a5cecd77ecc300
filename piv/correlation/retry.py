"""Other ways to correlate a pair whose first result explains too little of the pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from piv.correlation.options import WINDOW, Options
from piv.formats.plane_series import MASKED, OUTLIER, SECOND_PEAK, UNCERTAIN, VALID

_ENOUGH = 0.5  # of the vectors that are not masked, uncertain ones counted half
_BETTER = 0.1  # more of them make another way the better one
_CHANCE = 0.2  # with fewer, an uncertain vector may be anything

Correlate = Callable[[Any, Any, Options], xr.Dataset]


def best_of(a: Any, b: Any, options: Options, correlate: Correlate) -> xr.Dataset:
    """The result of `correlate`, or of another way where it explains more of the pictures.

    Ways: without what stands still in the pair (the lesser of both grey values), a larger window, a
    smaller and a larger search. Attribute `retried` names the way that was taken. Uncertain vectors
    are rejected where no way explains enough.
    """
    best = correlate(a, b, options)
    if _explained(best) >= _ENOUGH:
        return best
    taken = ""
    still = np.minimum(np.asarray(a, np.float32), np.asarray(b, np.float32))
    larger = min(1.5 * options.window, WINDOW[1], min(still.shape))
    ways: dict[str, tuple[Any, Any, Options]] = {
        "background from the pair": (a - still, b - still, options),
        f"window {larger:g} px": (a, b, replace(options, window=larger)),
    }
    for search in (options.search // 2, 2 * options.search):
        if 16 <= search <= 1024:
            ways[f"search {search} px"] = a, b, replace(options, search=search)
    for name, way in ways.items():
        try:
            other = correlate(*way)
        except ValueError:  # nothing moves in the pair
            continue
        if _explained(other) > _explained(best) + _BETTER:
            best, taken = other, name
        if _explained(best) >= _ENOUGH:
            break
    if _explained(best) < _CHANCE:
        best = _without_uncertain(best)
    return best.assign_attrs(retried=taken) if taken else best


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
