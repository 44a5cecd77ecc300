"""Datasets in HDF5 files: opened where the file can be walked, written whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from fileio.atomic import whole
from fileio.child_process import check_walkable
from fileio.errors import StageError, one_line
from fileio.hdf5_disk import Disk
from fileio.provenance import versions


def open_netcdf(
    path: str | Path, kind: str = "HDF5 file", *, load: bool = False, **options: Any
) -> xr.Dataset:
    """Open an HDF5 file, lazily unless `load` is given, when damage shows at once; `options` as xarray takes them.

    FileNotFoundError where it is missing; ValueError, which calls it a `kind`, where it is damaged or another one.
    """
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


def write_dataset(dataset: xr.Dataset, path: Path, groups: Mapping[str, xr.Dataset] | None = None) -> None:
    """Write an HDF5 file, and its groups, whole or not at all, with the versions that made it."""
    whole_netcdf(dataset.assign_attrs(versions=json.dumps(versions())), path, groups)


def read_dataset(path: Path, file_format: str, group: str | None = None) -> xr.Dataset:
    """Open one of this project's HDF5 files, or a group of it, which then has the file's attributes as well.

    Raises StageError where the file is missing, damaged or another one, or has no such group.
    """
    if not path.exists():
        raise StageError(f"{path}: missing; run the stage that writes it first, or make")
    try:
        dataset = open_netcdf(path, load=True)  # damage shows here, not in the middle of a stage
    except ValueError as error:
        raise StageError(f"{error}; delete it and run make again") from None
    if dataset.attrs.get("format") != file_format:
        raise StageError(f"{path}: format is {dataset.attrs.get('format')!r}, expected {file_format!r}")
    if group is None:
        return dataset
    attributes = dataset.attrs
    dataset.close()
    try:
        dataset = open_netcdf(path, load=True, group=group)
    except ValueError:
        raise StageError(f"{path}: no group {group!r}; delete it and run make again") from None
    return dataset.assign_attrs(attributes | dataset.attrs)
