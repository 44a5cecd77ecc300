"""A plane series written part by part along time, whole or not at all."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import h5netcdf
import h5py
import numpy as np
import xarray as xr
from numpy import ndarray

from piv.files.atomic import whole
from piv.files.hdf5_disk import Disk
from piv.formats.plane_series import AXES, SCHEMA, UNITS

_DEFLATE = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


def instant(fields: Mapping[str, ndarray]) -> xr.Dataset:
    """The variables of one instant, by their names in the schema, as a part of a series."""
    return xr.Dataset({n: (AXES[n], v[None], {"units": UNITS[n]}) for n, v in fields.items()})


def new_series(time: ndarray, x: ndarray, y: ndarray) -> xr.Dataset:
    """The axes (s and m) of a series whose parts are still to come."""
    axes = {"time": time, "y": y, "x": x}
    return xr.Dataset({n: (n, values, {"units": UNITS[n]}) for n, values in axes.items()})


def write_blocks(parts: Iterable[xr.Dataset], path: str | Path, like: xr.Dataset) -> None:
    """Write a series from its parts along time; all that they lack, but for fields, is of `like`.

    All parts hold the variables of the first. ValueError where parts are missing.
    """
    with (
        whole(path) as part_file,
        Disk(part_file, "w") as room,
        h5py.File(room, "w", track_order=True) as disk,
        h5netcdf.File(disk, "w") as file,
    ):
        file.dimensions = dict(like.sizes)
        made: dict[str, h5py.Dataset] = {}  # a look-up costs more than to write an instant
        begin = 0
        for part in parts:
            end = begin + part.sizes["time"]
            for name, field in ((str(n), f) for n, f in part.data_vars.items()):
                if name not in made:
                    _create(file, name, field)
                    made[name] = disk[name]
                made[name][begin:end] = field.values
            begin = end
        if begin != like.sizes["time"]:
            raise ValueError(f"{path}: {begin} of {like.sizes['time']} instants were made")
        for name, other in ((str(n), v) for n, v in like.variables.items()):
            if other.dims[-2:] != ("y", "x") and name not in made:
                data = np.asarray(other.values)
                variable = file.create_variable(name, other.dims, other.dtype, data=data)
                variable.attrs.update(other.attrs)
        file.attrs.update({**like.attrs, **SCHEMA.label})


def _create(file: h5netcdf.File, name: str, field: xr.DataArray) -> None:
    """Make a variable over all instants, fields with one chunk for each."""
    for axis, size in field.sizes.items():
        if axis not in file.dimensions:
            file.dimensions[axis] = size
    grid = field.dims[1:] == ("y", "x")
    chunks = {"chunks": (1, *field.shape[1:]), **_DEFLATE} if grid else {}
    variable = file.create_variable(name, field.dims, field.dtype, **chunks)
    variable.attrs.update({k: v for k, v in field.attrs.items() if k != "_FillValue"})
