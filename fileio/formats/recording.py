"""Writing of recordings, `images.h5` (docs/formats.md): one chunk per frame, resumable."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fileio.hdf5_disk import DiskFile, finish, resumed

FORMAT = "recording"
FORMAT_VERSION = 1
UNITS = {"frames": "1", "mask": "1", "time": "s", "row": "px", "column": "px"}


class RecordingWriter:
    """Writes frames in any order to `<path>.part`, which becomes `path` when `finish` is called.

    shape: (rows, columns); dtype: uint8 or uint16; `n_frames`; `attrs`: root attributes (docs/formats.md);
    `times` (n_frames,) in s, or taken from attrs["frame_rate_hz"]; `mask=True` where `write` will be given
    masks. Where a `.part` of the same shape and attributes exists, its finished frames are kept and named by
    `done`; any other or damaged `.part` is begun anew (`resumed` tells which). Raises ValueError on bad input.
    """

    def __init__(
        self,
        path: str | Path,
        shape: tuple[int, int],
        dtype: Any,
        n_frames: int,
        attrs: Mapping[str, Any],
        *,
        times: Sequence[float] | np.ndarray | None = None,
        mask: bool = False,
    ) -> None:
        self.path = Path(path)
        self.part = self.path.with_name(self.path.name + ".part")
        self.shape = (int(shape[0]), int(shape[1]))
        self.dtype = np.dtype(dtype)
        self.n_frames = int(n_frames)
        if self.dtype not in (np.uint8, np.uint16):
            raise ValueError(f"{self.path}: a recording holds uint8 or uint16 frames, not {self.dtype}")
        if self.n_frames < 1 or min(self.shape) < 1:
            raise ValueError(f"{self.path}: a recording needs at least one frame of at least one pixel")
        if times is None:
            if "frame_rate_hz" not in attrs:
                raise ValueError(f"{self.path}: give `times` or attrs['frame_rate_hz'] to a recording")
            times = np.arange(self.n_frames) / float(attrs["frame_rate_hz"])
        self.times = np.asarray(times, float)
        if self.times.shape != (self.n_frames,):
            raise ValueError(f"{self.path}: times have shape {self.times.shape}, expected ({self.n_frames},)")
        whole = [self.shape, str(self.dtype), self.n_frames, self.times.tolist(), mask, dict(attrs)]
        text = json.dumps(whole, sort_keys=True, default=_plain)
        self._identity = hashlib.sha256(text.encode()).hexdigest()
        found = resumed(self.part, self._identity)
        self.resumed = found is not None
        if found is not None:
            self._file = found
        else:
            self._begin(attrs, mask)
        self.done = np.flatnonzero(self._file["_done"][...])

    def _begin(self, attrs: Mapping[str, Any], mask: bool) -> None:
        self._file = DiskFile(self.part, "w")
        try:
            self._create(attrs, mask)
        except BaseException:
            self.part.unlink(missing_ok=True)  # not a frame in it
            self.close()
            raise

    def _create(self, attrs: Mapping[str, Any], mask: bool) -> None:
        rows, columns = self.shape
        self._axis("time", self.times)
        self._axis("row", np.arange(rows, dtype=np.int32))
        self._axis("column", np.arange(columns, dtype=np.int32))
        size = (self.n_frames, rows, columns)
        # All chunks are placed now, so that a kill while frames are written cannot break the file's index.
        early = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        early.set_chunk((1, rows, columns))
        early.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        early.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        space = h5py.h5s.create_simple(size)
        h5py.h5d.create(self._file.id, b"frames", h5py.h5t.py_create(self.dtype), space, early)
        self._label("frames", ("time", "row", "column"), UNITS["frames"])
        if mask:
            self._file.create_dataset(
                "mask", size, np.uint8, chunks=(1, rows, columns), compression="gzip", compression_opts=1
            )
            self._label("mask", ("time", "row", "column"), UNITS["mask"])
        self._file.create_dataset("_done", data=np.zeros(self.n_frames, np.uint8))
        for name, value in attrs.items():
            self._file.attrs[name] = _attribute(value)
        self._file.attrs["format"] = FORMAT
        self._file.attrs["format_version"] = FORMAT_VERSION
        self._file.flush()
        self._file.attrs["_identity"] = self._identity  # last: a file that has it is whole but for its frames
        self._file.flush()

    def _axis(self, name: str, values: np.ndarray) -> None:
        axis = self._file.create_dataset(name, data=values)
        axis.make_scale(name)
        axis.attrs["units"] = UNITS.get(name, "1")

    def _label(self, name: str, dims: Sequence[str], units: str) -> None:
        data = self._file[name]
        for k, dim in enumerate(dims):
            data.dims[k].attach_scale(self._file[dim])
        data.attrs["units"] = units

    def write(self, i: int, frame: np.ndarray, mask: np.ndarray | None = None) -> None:
        """Store frame `i` (row 0 at the top) and its mask (True or 1 = body); on disk when this returns."""
        if frame.shape != self.shape or frame.dtype != self.dtype:
            raise ValueError(
                f"{self.path}: frame {i} is {frame.shape} {frame.dtype}, expected {self.shape} {self.dtype}"
            )
        if (mask is not None) != ("mask" in self._file):
            raise ValueError(f"{self.path}: give a mask with every frame or with none (frame {i})")
        if not 0 <= i < self.n_frames:
            raise ValueError(f"{self.path}: frame {i} is outside the recording's {self.n_frames} frames")
        self._file["frames"][i] = frame
        if mask is not None:
            self._file["mask"][i] = np.asarray(mask).astype(bool).astype(np.uint8)
        self._file.flush()
        self._file["_done"][i] = 1
        self._file.flush()

    def add(self, name: str, dims: Sequence[str], values: np.ndarray, units: str, **attrs: Any) -> None:
        """Store a further variable, e.g. "outline" or "truth/u"; new dimensions are made from its shape.

        `dims` names one dimension per axis of `values`; a 1-D variable named like its only dimension is a
        coordinate and must come before the variables that use it. An existing variable is replaced.
        """
        values = np.asarray(values)
        if values.ndim != len(dims):
            raise ValueError(f"{self.path}: {name} has {values.ndim} axes but {len(dims)} dimensions")
        if name in self._file:
            if tuple(dims) == (name,):
                self._file[name][...] = values
                return
            del self._file[name]
        if tuple(dims) == (name,):
            self._axis(name, values)
            self._file[name].attrs["units"] = units
            return
        for dim, size in zip(dims, values.shape, strict=True):
            if dim not in self._file:
                self._axis(dim, np.arange(size, dtype=np.int32))
            elif self._file[dim].shape != (size,):
                raise ValueError(
                    f"{self.path}: dimension {dim} of {name} is {size}, in the file {self._file[dim].shape[0]}"
                )
        chunks = (1, *values.shape[1:]) if dims[0] == "time" and values.ndim > 2 else None
        squeeze = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if chunks else {}
        self._file.create_dataset(name, data=values, chunks=chunks, **squeeze)
        self._label(name, dims, units)
        for key, value in attrs.items():
            self._file[name].attrs[key] = _attribute(value)
        self._file.flush()

    def finish(self) -> Path:
        """Give the file its name; ValueError where frames are missing."""
        missing = np.flatnonzero(self._file["_done"][...] == 0)
        if missing.size:
            raise ValueError(
                f"{self.path}: {missing.size} of {self.n_frames} frames were not written, the first is {missing[0]}"
            )
        finish(self._file, self.part, self.path)
        return self.path

    def close(self) -> None:
        """Leave the `.part` for a later run."""
        if self._file:
            self._file.close()

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _attribute(value: Any) -> Any:
    """HDF5 attributes hold numbers and text; anything nested becomes JSON."""
    if isinstance(value, dict | list | tuple) or value is None:
        return json.dumps(value, default=_plain)
    return value
