"""Series that are longer than memory: read block by block, written instant by instant."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import h5netcdf
import numpy as np
import xarray as xr

from fileio.atomic import whole
from fileio.formats.plane_series import BLOCK, SCHEMA, check_vectors


def fields_of(plane: xr.Dataset) -> list[str]:
    """Names of what is given at every vector: variables over (y, x), or (time, y, x)."""
    return [str(n) for n, v in plane.data_vars.items() if v.dims[-2:] == ("y", "x")]


def blocks(series: xr.Dataset, names: list[str] | None = None) -> Iterator[xr.Dataset]:
    """The series' fields (or `names` of them) in parts along time, each in memory and checked; a single plane as a series of one."""
    data = series[names or fields_of(series)]
    if "time" not in data.dims:
        data = data.expand_dims("time").assign_coords(time=[float(data.coords.get("time", 0.0))])
    step = max(1, BLOCK // (data.sizes["y"] * data.sizes["x"]))
    for begin in range(0, data.sizes["time"], step):
        part = data.isel(time=slice(begin, begin + step)).load()
        check_vectors(part)
        yield part


def write_blocks(parts: Iterator[xr.Dataset], path: str | Path, like: xr.Dataset) -> None:
    """Write a series from its parts along time, whole or not at all; further variables and attributes are those of `like`.

    `like` without time: the one instant becomes a single plane. OSError where the disk refuses it.
    """
    series = "time" in like["u"].dims
    dims = ("time", "y", "x") if series else ("y", "x")
    count = like.sizes.get("time", 1)
    with whole(path) as temporary, h5netcdf.File(temporary, "w") as file:
        file.dimensions = {d: like.sizes[d] for d in like.dims}
        begin = 0
        for part in parts:
            for name in map(str, part.data_vars):
                if name not in file.variables:
                    kind = part[name].dtype
                    chunks = (1, *part[name].shape[1:])[-len(dims) :]
                    made = file.create_variable(
                        name, dims, kind, compression="gzip", compression_opts=1, chunks=chunks
                    )
                    made.attrs.update({k: v for k, v in part[name].attrs.items() if k != "_FillValue"})
                values = part[name].values
                if series:
                    file[name][begin : begin + len(values)] = values
                else:
                    file[name][...] = values[0]
            begin += part.sizes["time"]
        if begin != count:
            raise ValueError(f"{path}: {begin} of {count} instants were made")
        for name in map(str, like.variables):
            if name not in file.variables:
                made = file.create_variable(
                    name, like[name].dims, like[name].dtype, data=np.asarray(like[name].values)
                )
                made.attrs.update(like[name].attrs)
        file.attrs.update(like.attrs | SCHEMA.label)
