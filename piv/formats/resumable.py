"""A plane series written field by field; an interrupted run loses no finished field."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from piv.files.resumable_file import ResumableFile
from piv.formats.plane_series import AXES, SCHEMA, UNITS

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
    """Fields of a plane series in any order; `finish` renames the file.

    x, y, time: coordinates; units: of x, y, time and u (with v, u_std, v_std); attrs: root
    attributes; identity: the inputs of the fields. A series of the same identity is continued.
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
            name: np.asarray(values, float) for name, values in (("x", x), ("y", y), ("time", time))
        }
        self._units = units
        key = [identity, *(values.tolist() for values in self._axes.values())]
        super().__init__(path, len(time), key, {**attrs, **SCHEMA.label})

    def _create(self) -> None:
        for name, values in self._axes.items():
            self.axis(name, values, self._units[name])
        for name, kind in FIELDS.items():
            units = self._units["u"] if UNITS[name] == "m/s" else UNITS[name]
            self.add_items(name, AXES[name], units, kind)

    def write(self, index: int, fields: dict[str, np.ndarray]) -> None:
        """Store one field (y, x each); on disk when this returns."""
        self.store(index, {name: fields.get(name, np.nan) for name in FIELDS})

    def add(
        self, name: str, dims: tuple[str, ...], shape: tuple[int, ...], blocks: Iterable[np.ndarray]
    ) -> None:
        """A further variable of docs/formats.md, float64, in blocks along its first axis."""
        self._add(name, dims, shape, blocks, UNITS.get(name, "1"))
