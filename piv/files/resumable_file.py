"""HDF5 files written item by item in any order; an interrupted run loses no finished item."""

import hashlib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np

from piv.files.atomic import sync_file
from piv.files.errors import system_error
from piv.files.hdf5 import check_hdf5
from piv.files.hdf5_disk import DiskFile
from piv.files.json_text import plain

# bytes of each variable that HDF5 keeps: none, as items are written once; its default is 8 MB
_CACHE = 0


class ResumableFile:
    """Items of a kind (`ITEM`) written to `<path>.part`, which `finish` renames to `path`.

    `identity`: the inputs of the items. A `.part` of the same identity is continued (`done`: its
    items; `resumed` is True); any other or a damaged one is begun anew: `_create` makes its
    datasets, and `attrs` become its root attributes.
    """

    ITEM = "item"

    def __init__(
        self, path: str | Path, count: int, identity: Any, attrs: Mapping[str, Any]
    ) -> None:
        self.path = Path(path)
        self.part = self.path.with_name(self.path.name + ".part")
        self.count = count
        self._open: dict[str, h5py.Dataset] = {}  # a look-up takes as long as a write
        text = json.dumps(identity, sort_keys=True, default=plain)
        self._identity = hashlib.sha256(text.encode()).hexdigest()
        self.resumed = self._continue()
        if not self.resumed:
            self._begin(attrs)
        self.done: set[int] = set(np.flatnonzero(self._file["_done"][...]).tolist())

    def _continue(self) -> bool:
        """Open an unfinished file of this identity; False without one."""
        if self.part.is_symlink():
            self.part.unlink()  # its target stays as it is
        if not self.part.exists():
            return False
        try:
            check_hdf5(self.part)
            self._file = DiskFile(self.part, "r+", rdcc_nbytes=_CACHE)
        except (OSError, ValueError):
            return False  # killed while the file was being created
        if self._file.attrs.get("_identity") == self._identity:
            return True
        self._file.close()
        return False

    def _begin(self, attrs: Mapping[str, Any]) -> None:
        self._file = DiskFile(self.part, "w", rdcc_nbytes=_CACHE)
        try:
            self._create()
            self._file.create_dataset("_done", data=np.zeros(self.count, np.uint8))
            # h5py reads them in this order: a file joined of others is equal to the last byte
            for name in sorted(attrs):
                self._file.attrs[name] = _attribute(attrs[name])
            self._file.flush()
            # last: a file with it lacks nothing but items
            self._file.attrs["_identity"] = self._identity
            self._file.flush()
        except BaseException:
            self.part.unlink(missing_ok=True)  # it has no items
            self.close()
            raise

    def _create(self) -> None:
        raise NotImplementedError

    def axis(self, name: str, values: Any, units: str = "1") -> None:
        """Create the variable of a coordinate."""
        axis = self._file.create_dataset(name, data=values)
        axis.make_scale(name)
        axis.attrs["units"] = units

    def add_items(self, name: str, dims: Sequence[str], units: str, dtype: Any) -> None:
        """Add a variable over the coordinates `dims`, one chunk per item.

        Its chunks are placed now, so that a kill during a write cannot break the file's index.
        """
        size = tuple(len(self._file[dim]) for dim in dims)
        early = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        early.set_chunk((1, *size[1:]))
        early.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        early.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        early.set_obj_track_times(False)  # equal items give equal files
        space = h5py.h5s.create_simple(size)
        h5py.h5d.create(
            self._file.id, name.encode(), h5py.h5t.py_create(np.dtype(dtype)), space, early
        )
        self.label(name, dims, units)

    def label(self, name: str, dims: Sequence[str], units: str) -> None:
        """Attach a variable's coordinates and units."""
        for k, dim in enumerate(dims):
            self._file[name].dims[k].attach_scale(self._file[dim])
        self._file[name].attrs["units"] = units

    def _add(
        self, name: str, dims: Sequence[str], shape: tuple[int, ...], blocks: Iterable[np.ndarray],
        units: str,
    ) -> None:  # fmt: skip
        """Add or replace a variable (float64), in blocks along its first axis."""
        if name in self._file:
            del self._file[name]
        for dim, size in zip(dims, shape, strict=True):
            if dim not in self._file:
                self.axis(dim, np.arange(size, dtype=np.int32))
        variable = self._file.create_dataset(name, shape, "f8")
        begin = 0
        for values in blocks:
            variable[begin : begin + len(values)] = values
            begin += len(values)
        self.label(name, dims, units)

    def store(self, index: int, values: Mapping[str, Any]) -> None:
        """Write an item of the variables in `values`; on disk when this returns."""
        for name, value in values.items():
            self._variable(name)[index] = value
        self._file.flush()
        self._variable("_done")[index] = 1
        self._file.flush()

    def _variable(self, name: str) -> h5py.Dataset:
        if name not in self._open:
            self._open[name] = self._file[name]
        return self._open[name]

    def finish(self) -> Path:
        """Rename the file, without the state of its items; ValueError where items are missing."""
        missing = np.flatnonzero(self._file["_done"][...] == 0)
        if missing.size:
            raise ValueError(
                f"{self.path}: {missing.size} of {self.count} {self.ITEM}s were not written, the"
                f" first is {missing[0]}"
            )
        self._file.flush()
        sync_file(self.part)  # an error of a full disk must come while the file can be resumed
        del self._file["_done"]
        del self._file.attrs["_identity"]
        self._file.close()
        sync_file(self.part)
        os.replace(self.part, self.path)
        return self.path

    def close(self) -> None:
        """Leave the `.part` for a later run."""
        if self._file:
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self.close()
        if isinstance(error, ValueError) and system_error(error) is None:
            self.part.unlink(missing_ok=True)  # a later run would fail alike


def _attribute(value: Any) -> Any:
    """HDF5 attributes hold numbers and text; anything nested becomes JSON."""
    nested = isinstance(value, dict | list | tuple) or value is None
    return json.dumps(value, default=plain) if nested else value
