"""Datasets in HDF5 files: checked before opening, written atomically."""

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

# h5netcdf 1.8.2 sets it after opening: deleting a file that failed to open prints a traceback
h5netcdf.File._writable = False


def open_netcdf(
    path: str | Path, kind: str = "HDF5 file", *, load: bool = False, **options: Any
) -> xr.Dataset:
    """Open an HDF5 file, lazily unless `load`; `options` of xarray.open_dataset.

    FileNotFoundError where it is missing; ValueError with the name `kind` where it is unreadable.
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
    """Write a dataset and `groups` by name to an HDF5 file, atomically; `encoding` as in xarray.

    OSError where the disk refuses it.
    """
    with whole(path) as part, Disk(part, "w") as disk:
        dataset.to_netcdf(disk, engine="h5netcdf", encoding=encoding)
        for name, group in (groups or {}).items():
            group.to_netcdf(disk, engine="h5netcdf", mode="a", group=name)
