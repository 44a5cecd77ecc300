"""Values that are not finite, named by quantity and instant before they enter a result."""

from __future__ import annotations

from collections.abc import Iterable
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from fileio.formats.plane_series import Planes, check_vectors, vectors_of

_AGAIN = "make the file again"


def check_finger(plane: xr.Dataset, names: Iterable[str], path: Path) -> None:
    """ValueError with the variable and the instant where a finger's value is no number."""
    for name in names:
        values = plane[name].values
        bad = np.flatnonzero(~np.isfinite(values).reshape(len(values), -1).all(axis=1))
        if bad.size:
            at = f"{name} at {float(plane['time'].values[bad[0]]):g} s (frame {bad[0]})"
            raise ValueError(f"{path}: {at} is no number; {_AGAIN}")


def check_table(table: pd.DataFrame, names: Iterable[str], path: Path) -> None:
    """ValueError with the column, track and instant where a table of vortices has no number."""
    for name in names:
        bad = table[~np.isfinite(table[name].astype(float))]
        if len(bad):
            at = f"{name} of track {bad.iloc[0]['track']:g} at {bad.iloc[0]['time']:g} s"
            raise ValueError(f"{path}: {at} is no number; {_AGAIN}")


@xr.register_dataset_accessor("vectors")
class _Vectors(Planes):
    """The vectors alone of a plane series, by the instant's number."""

    def __init__(self, series: xr.Dataset) -> None:
        super().__init__(vectors_of(series))


def checked_frame(plane: xr.Dataset, index: int) -> xr.Dataset:
    """The vectors of one instant, in memory; ValueError where a valid vector is no number."""
    now = plane.vectors[index]
    try:
        check_vectors(now)
    except ValueError as error:
        file = plane.encoding.get("source", "a series")
        raise ValueError(f"{file}: frame {index}: {error}; {_AGAIN}") from None
    return now


def first_not_finite(content: Any, place: str = "") -> str | None:
    """Path of the first number in nested dicts and lists that is not finite; None without one."""
    if isinstance(content, dict):
        parts = ((f"{place}.{key}" if place else str(key), value) for key, value in content.items())
    elif isinstance(content, list | tuple):
        parts = ((f"{place}[{k}]", value) for k, value in enumerate(content))
    else:
        number = isinstance(content, float | np.floating)
        return (place or "it") if number and not isfinite(content) else None
    return next((where for name, value in parts if (where := first_not_finite(value, name))), None)
