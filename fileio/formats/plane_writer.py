"""A plane series written instant by instant, whole or not at all: only one plane is in memory at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np

from fileio.atomic import whole
from fileio.formats.plane_series import AXES, SCHEMA, UNITS
from fileio.hdf5_disk import Disk


class PlaneWriter:
    """Instants of a plane series in an open file; what the first holds, all of them hold."""

    def __init__(self, file: h5netcdf.File, x: np.ndarray, y: np.ndarray, count: int) -> None:
        self._file = file
        for name, values in (("time", np.zeros(count)), ("y", y), ("x", x)):
            file.dimensions[name] = len(values)
            self._variable(name, (name,), np.float64)[...] = values

    def write(self, index: int, time: float, fields: Mapping[str, np.ndarray]) -> None:
        """The variables of one instant (s) by their names in the schema."""
        self._file.variables["time"][index] = time
        for name, values in fields.items():
            if name not in self._file.variables:
                self._create(name, values)
            self._file.variables[name][index] = values

    def _create(self, name: str, values: np.ndarray) -> None:
        axes = AXES[name]
        for axis, size in zip(axes[1:], values.shape, strict=True):
            if axis not in self._file.dimensions:
                self._file.dimensions[axis] = size
        if axes[1:] != ("y", "x"):
            self._variable(name, axes, np.float64)
            return
        deflate = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
        self._variable(name, axes, values.dtype.type, chunks=(1, *values.shape), **deflate)

    def _variable(self, name: str, axes: tuple[str, ...], kind: type, **more: Any) -> h5netcdf.Variable:
        variable = self._file.create_variable(name, axes, kind, **more)
        variable.attrs["units"] = UNITS[name]
        return variable


@contextmanager
def writing_planes(
    path: Path, x: np.ndarray, y: np.ndarray, count: int, attributes: Mapping[str, Any]
) -> Iterator[PlaneWriter]:
    """A new plane series of `count` instants on the grid `x`, `y` (m), in its place when the block has ended well."""
    with whole(path) as part, Disk(part, "w") as disk, h5netcdf.File(disk, "w") as file:
        yield PlaneWriter(file, x, y, count)
        file.attrs.update({**attributes, **SCHEMA.label})
