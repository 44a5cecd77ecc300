"""A plane series written vector field by vector field, so that an interrupted run loses none that was finished."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fileio.formats.plane_series import FORMAT, FORMAT_VERSION, UNITS
from fileio.hdf5_disk import DiskFile, finish, resumed

FIELDS = {
    "u": "f4",
    "v": "f4",
    "valid": "u1",
    "flag": "u1",
    "u_std": "f4",
    "v_std": "f4",
    "correlation": "f4",
}


class SeriesWriter:
    """Fields of a plane series in any order to `<path>.part`, which becomes `path` when all are there.

    x, y, time: coordinates; units: of x, y, time and u (with v, u_std, v_std); attrs: root attributes; identity:
    what the fields depend on. A `.part` of the same identity is continued (`done` names its fields), any other or
    a damaged one is begun anew.
    """

    def __init__(
        self, path: str | Path, x, y, time, units: dict[str, str], attrs: dict[str, Any], identity: Any
    ):
        self.path = Path(path)
        self.part = self.path.with_name(self.path.name + ".part")
        self.count = len(time)
        key = json.dumps(
            [identity, list(map(float, x)), list(map(float, y)), list(map(float, time))], default=str
        )
        self._identity = hashlib.sha256(key.encode()).hexdigest()
        found = resumed(self.part, self._identity)
        if found is not None:
            self._file = found
        else:
            self._begin({"x": x, "y": y, "time": time}, units, attrs)
        self._fields = {name: self._file[name] for name in FIELDS}
        self.done = set(np.flatnonzero(self._file["_done"][...]).tolist())

    def _begin(self, axes: dict[str, Any], units: dict[str, str], attrs: dict[str, Any]) -> None:
        self._file = DiskFile(self.part, "w")
        try:
            self._create(axes, units, attrs)
        except BaseException:
            self.part.unlink(missing_ok=True)  # not a field in it
            self.close()
            raise

    def _create(self, axes: dict[str, Any], units: dict[str, str], attrs: dict[str, Any]) -> None:
        for name, values in axes.items():
            axis = self._file.create_dataset(name, data=np.asarray(values, float))
            axis.make_scale(name)
            axis.attrs["units"] = units[name]
        size = (self.count, len(axes["y"]), len(axes["x"]))
        # Chunks are placed now, so that a kill while a field is written cannot break the file's index.
        early = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        early.set_chunk((1, *size[1:]))
        early.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        early.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        early.set_obj_track_times(False)  # equal fields give equal files
        for name, kind in FIELDS.items():
            space = h5py.h5s.create_simple(size)
            h5py.h5d.create(self._file.id, name.encode(), h5py.h5t.py_create(np.dtype(kind)), space, early)
            plain = name in ("valid", "flag", "correlation")
            self._label(name, ("time", "y", "x"), "1" if plain else units["u"])
        self._file.create_dataset("_done", data=np.zeros(self.count, np.uint8))
        for name in sorted(
            attrs
        ):  # h5py reads them in this order: a file joined of others is equal to the last byte
            self._file.attrs[name] = attrs[name]
        self._file.attrs["format"] = FORMAT
        self._file.attrs["format_version"] = FORMAT_VERSION
        self._file.flush()
        self._file.attrs["_identity"] = self._identity  # last: a file that has it is whole but for its fields
        self._file.flush()

    def _label(self, name: str, dims: tuple[str, ...], units: str) -> None:
        for k, dim in enumerate(dims):
            self._file[name].dims[k].attach_scale(self._file[dim])
        self._file[name].attrs["units"] = units

    def write(self, index: int, fields: dict[str, np.ndarray]) -> None:
        """Store one field (y, x each); on disk when this returns."""
        for name, variable in self._fields.items():
            variable[index] = fields.get(name, np.nan)
        self._file.flush()
        self._file["_done"][index] = 1
        self._file.flush()

    def add(
        self, name: str, dims: tuple[str, ...], shape: tuple[int, ...], blocks: Iterable[np.ndarray]
    ) -> None:
        """A further variable of docs/formats.md, float64, in blocks along its first axis; new dimensions are numbered."""
        if name in self._file:
            del self._file[name]
        for dim, size in zip(dims, shape, strict=True):
            if dim not in self._file:
                self._file.create_dataset(dim, data=np.arange(size, dtype=np.int32)).make_scale(dim)
        variable = self._file.create_dataset(name, shape, "f8")
        begin = 0
        for values in blocks:
            variable[begin : begin + len(values)] = values
            begin += len(values)
        self._label(name, dims, UNITS.get(name, "1"))

    def finish(self) -> Path:
        """Give the file its name; ValueError where fields are missing."""
        missing = np.flatnonzero(self._file["_done"][...] == 0)
        if missing.size:
            raise ValueError(
                f"{self.path}: {missing.size} of {self.count} fields are missing, the first is {missing[0]}"
            )
        finish(self._file, self.part, self.path)
        return self.path

    def close(self) -> None:
        """Leave the `.part` for a later run."""
        if self._file:
            self._file.close()
