"""A plane series written vector field by vector field, so that an interrupted run loses none that was finished."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from fileio.formats.plane_series import AXES, SCHEMA, UNITS
from fileio.resumable_file import ResumableFile

FIELDS = {
    "u": "f4",
    "v": "f4",
    "valid": "u1",
    "flag": "u1",
    "u_std": "f4",
    "v_std": "f4",
    "correlation": "f4",
}


class SeriesWriter(ResumableFile):
    """Fields of a plane series in any order; `finish` gives the file its name.

    x, y, time: coordinates; units: of x, y, time and u (with v, u_std, v_std); attrs: root attributes; identity:
    what the fields depend on. An interrupted series of the same identity is continued.
    """

    ITEM = "field"

    def __init__(
        self,
        path: str | Path,
        x,
        y,
        time,
        units: dict[str, str],
        attrs: dict[str, Any],
        identity: Any,
    ):
        self._axes = {
            "x": np.asarray(x, float),
            "y": np.asarray(y, float),
            "time": np.asarray(time, float),
        }
        self._units = units
        key = [identity, *(values.tolist() for values in self._axes.values())]
        super().__init__(path, len(time), key, {**attrs, **SCHEMA.label})

    def _create(self) -> None:
        for name, values in self._axes.items():
            self.axis(name, values, self._units[name])
        for name, kind in FIELDS.items():
            self.items(name, tuple(len(self._axes[dim]) for dim in AXES[name]), kind)
            self.label(name, AXES[name], self._units["u"] if UNITS[name] == "m/s" else UNITS[name])

    def write(self, index: int, fields: dict[str, np.ndarray]) -> None:
        """Store one field (y, x each); on disk when this returns."""
        self.store(index, {name: fields.get(name, np.nan) for name in FIELDS})

    def add(
        self, name: str, dims: tuple[str, ...], shape: tuple[int, ...], blocks: Iterable[np.ndarray]
    ) -> None:
        """A further variable of docs/formats.md, float64, in blocks along its first axis; new dimensions are numbered."""
        if name in self._file:
            del self._file[name]
        for dim, size in zip(dims, shape, strict=True):
            if dim not in self._file:
                self.axis(dim, np.arange(size, dtype=np.int32))
        variable = self._file.create_dataset(name, shape, "f8")
        begin = 0
        for values in blocks:
            variable[begin : begin + len(values)] = values
            begin += len(values)
        self.label(name, dims, UNITS.get(name, "1"))
