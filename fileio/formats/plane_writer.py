"""A plane series written instant by instant or block by block, whole or not at all."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import numpy as np
import xarray as xr

from fileio.atomic import whole
from fileio.formats.plane_series import AXES, SCHEMA, UNITS
from fileio.hdf5_disk import Disk

_DEFLATE = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


class _PlaneWriter:
    """Instants of a plane series in an open file; all hold the variables of the first."""

    def __init__(
        self, disk: h5py.File, file: h5netcdf.File, x: np.ndarray, y: np.ndarray, count: int
    ) -> None:
        self._disk, self._file = disk, file
        self._made: dict[str, h5py.Dataset] = {}  # a look-up costs more than to write an instant
        for name, values in (("time", np.zeros(count)), ("y", y), ("x", x)):
            file.dimensions[name] = len(values)
            self._variable(name, (name,), np.float64)
            self._made[name][...] = values

    def write(self, index: int, time: float, fields: Mapping[str, np.ndarray]) -> None:
        """Write the variables of one instant (s) by their names in the schema."""
        self._made["time"][index] = time
        for name, values in fields.items():
            if name not in self._made:
                self._create(name, values)
            self._made[name][index] = values

    def _create(self, name: str, values: np.ndarray) -> None:
        axes = AXES[name]
        for axis, size in zip(axes[1:], values.shape, strict=True):
            if axis not in self._file.dimensions:
                self._file.dimensions[axis] = size
        if axes[1:] == ("y", "x"):
            self._variable(name, axes, values.dtype.type, chunks=(1, *values.shape), **_DEFLATE)
        else:
            self._variable(name, axes, np.float64)

    def _variable(self, name: str, axes: tuple[str, ...], kind: type, **more: Any) -> None:
        self._file.create_variable(name, axes, kind, **more).attrs["units"] = UNITS[name]
        self._made[name] = self._disk[name]


@contextmanager
def writing_planes(
    path: Path, x: np.ndarray, y: np.ndarray, count: int, attributes: Mapping[str, Any]
) -> Iterator[_PlaneWriter]:
    """A new plane series of `count` instants on the grid `x`, `y` (m), there at the block's end."""
    with _new_file(path, attributes) as (disk, file):
        yield _PlaneWriter(disk, file, x, y, count)


def write_blocks(parts: Iterator[xr.Dataset], path: str | Path, like: xr.Dataset) -> None:
    """Write a series from its parts along time; what they lack off the grid is that of `like`.

    `like` without time: the one instant becomes a single plane. ValueError where the parts are not
    as many instants as `like`.
    """
    dims, count = like["u"].dims, like.sizes.get("time", 1)
    with _new_file(path, like.attrs) as (disk, file):
        file.dimensions = {d: like.sizes[d] for d in like.dims}
        made: dict[str, h5py.Dataset] = {}
        begin = 0
        for part in parts:
            for name, field in ((str(n), f) for n, f in part.data_vars.items()):
                values = field.values if "time" in dims else field.values[0]
                if name not in made:
                    axes = field.dims[-values.ndim :] if "time" not in dims else field.dims
                    grid = axes[-2:] == ("y", "x")
                    chunks = {"chunks": (1, *values.shape[-2:])[-len(dims) :], **_DEFLATE}
                    variable = file.create_variable(
                        name, axes, values.dtype, **(chunks if grid else {})
                    )
                    variable.attrs.update(
                        {k: v for k, v in field.attrs.items() if k != "_FillValue"}
                    )
                    made[name] = disk[name]
                place = slice(begin, begin + len(values)) if "time" in dims else ...
                made[name][place] = values
            begin += part.sizes["time"]
        if begin != count:
            raise ValueError(f"{path}: {begin} of {count} instants were made")
        for key, other in like.variables.items():
            if other.dims[-2:] != ("y", "x") and key not in made:
                variable = file.create_variable(
                    key, other.dims, other.dtype, data=np.asarray(other.values)
                )
                variable.attrs.update(other.attrs)


@contextmanager
def _new_file(
    path: str | Path, attributes: Mapping[str, Any]
) -> Iterator[tuple[h5py.File, h5netcdf.File]]:
    """The file as HDF5 and as netCDF."""
    with (
        whole(path) as part,
        Disk(part, "w") as room,
        h5py.File(room, "w", track_order=True) as disk,
        h5netcdf.File(disk, "w") as file,
    ):
        yield disk, file
        file.attrs.update({**attributes, **SCHEMA.label})
