"""Series that are longer than memory, read block by block."""

from collections.abc import Iterator

import xarray as xr

from piv.formats.plane_series import BLOCK, check_vectors, fields_of


def blocks(series: xr.Dataset) -> Iterator[xr.Dataset]:
    """The series' fields in checked parts along time; a plane as a series of one."""
    data = series[fields_of(series)]
    if "time" not in data.dims:
        data = data.expand_dims("time").assign_coords(time=[float(data.coords.get("time", 0.0))])
    step = max(1, BLOCK // (data.sizes["y"] * data.sizes["x"]))
    for begin in range(0, data.sizes["time"], step):
        part = data.isel(time=slice(begin, begin + step)).load()
        check_vectors(part)
        yield part
