"""Datasets in HDF5 files: opened where the file can be walked, written whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5netcdf
import xarray as xr

from fileio.atomic import whole
from fileio.child_process import check_walkable
from fileio.errors import one_line
from fileio.hdf5_disk import Disk
from fileio.record import check_whole

# h5netcdf 1.8.2 sets it once the file is open: of one that it cannot open it would print a traceback where it is tidied up
h5netcdf.File._writable = False


def open_netcdf(
    path: str | Path, kind: str = "HDF5 file", *, load: bool = False, **options: Any
) -> xr.Dataset:
    """Open an HDF5 file, lazily unless `load` is given, when damage shows at once; `options` as xarray takes them.

    FileNotFoundError where it is missing; ValueError, which calls it a `kind`, where it is damaged or another one.
    """
    check_whole(path)
    check_walkable(path)
    try:
        dataset = xr.open_dataset(path, engine="h5netcdf", phony_dims="access", **options)
        return dataset.load() if load else dataset
    except FileNotFoundError:
        raise
    except Exception as error:  # the library raises many kinds on damaged files
        raise ValueError(f"{path}: not a readable {kind} ({one_line(error)})") from error


def whole_netcdf(
    dataset: xr.Dataset,
    path: str | Path,
    groups: Mapping[str, xr.Dataset] | None = None,
    encoding: dict[str, dict[str, Any]] | None = None,
) -> None:
    """Write a dataset, and `groups` by their names, to an HDF5 file, whole or not at all; `encoding` of the dataset as
    xarray takes it. OSError where the disk refuses it.
    """
    with whole(path) as part, Disk(part, "w") as disk:
        dataset.to_netcdf(disk, engine="h5netcdf", encoding=encoding)
        for name, group in (groups or {}).items():
            group.to_netcdf(disk, engine="h5netcdf", mode="a", group=name)
