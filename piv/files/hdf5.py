"""HDF5 files: checked before opening, written atomically."""

from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import xarray as xr

from piv.files.atomic import whole
from piv.files.child_process import read_in_child
from piv.files.errors import one_line
from piv.files.hdf5_disk import Disk
from piv.files.record import check_whole

# h5netcdf 1.8.2 sets it after opening: deleting a file that failed to open prints a traceback
h5netcdf.File._writable = False
WALK_LIMIT = 3  # s of CPU time; walking a sound file takes milliseconds


def check_hdf5(path: str | Path) -> None:
    """ValueError where a file holds the data of others, or the library cannot get through it.

    A file that no record vouches for is walked in a process of its own, which may die of it.
    """
    known = check_whole(path)
    if Path(path).is_file():
        state = Path(path).stat()
        _walk_once(str(path), known, state.st_mtime_ns, state.st_size, state.st_ino)


@lru_cache(maxsize=256)
def _walk_once(path: str, known: bool, *state: int) -> None:
    """Walk a file in this state once: a stage opens the same file several times."""
    try:
        outside = _walk(path) if known else read_in_child(_walk, path, cpu_limit=WALK_LIMIT)
    except ChildProcessError:
        raise ValueError(
            f"{path}: damaged: the HDF5 library cannot get through its structure"
        ) from None
    if outside:
        raise ValueError(
            f"{path}: {outside} lies in another file, which is not opened; write the values"
            " themselves into this file"
        )


def _walk(path: str) -> str | None:
    """Read all of a file's structure; the first item whose values lie in another file, if any."""
    found: list[str] = []

    def link(name: str, item: Any) -> None:
        if isinstance(item, h5py.ExternalLink):
            found.append(name)

    def visit(name: str, item: h5py.Group | h5py.Dataset) -> None:
        for attribute in item.attrs:
            item.attrs[attribute]
        if isinstance(item, h5py.Dataset):
            if item.is_virtual or item.external:
                found.append(name)
            elif item.chunks is not None:
                item.id.get_num_chunks()

    # of damaged files the library raises many kinds: the caller's own opening reports it
    with suppress(Exception), h5py.File(path, "r") as file:
        file.visititems_links(link)
        visit("/", file)
        file.visititems(visit)
    return found[0] if found else None


def open_hdf5(path: str | Path) -> h5py.File:
    """Open a file to read; FileNotFoundError, or ValueError where it is unreadable."""
    check_hdf5(path)
    try:
        return h5py.File(path, "r")
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: no such file") from None
    except OSError as error:
        raise ValueError(f"{path}: not a readable HDF5 file ({one_line(error)})") from error


def open_netcdf(
    path: str | Path, kind: str = "HDF5 file", *, load: bool = False, **options: Any
) -> xr.Dataset:
    """Open an HDF5 file, lazily unless `load`; `options` of xarray.open_dataset.

    FileNotFoundError where it is missing; ValueError with the name `kind` where it is unreadable.
    """
    check_hdf5(path)
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
