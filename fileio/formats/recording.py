"""Recordings, `images.h5` (docs/formats.md): one chunk per frame, written resumably."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fileio.child_process import check_walkable
from fileio.errors import StageError, one_line
from fileio.formats.plane_series import FINGERS, ORIGIN, REMEDY
from fileio.provenance import check_version
from fileio.record import check_whole
from fileio.resumable_file import ResumableFile, attribute
from fileio.schema import Schema, Variable

SCHEMA = Schema(
    "recording", 1, REMEDY,
    (
        Variable("time", "time", "s", "of each frame; not even where `camera` has `pairs_every` > 1: two frames in a row out of every so many"),
        Variable("row", "row", "px", "from the top"),
        Variable("column", "column", "px", "from the left"),
        Variable("frames", "time, row, column", "1", "uint8 or uint16, **row 0 at the top** as a camera writes it, one chunk per frame"),
        Variable("mask", "time, row, column", "1", "uint8, 1 = body", True),
        *FINGERS,
        Variable("scale_m_per_px", "-", "m/px", "size of a pixel in the light sheet", True),
        Variable("origin_x_px", "-", "px", "position of the tank frame's origin, right of the centre of the left column", True),
        Variable("origin_y_px", "-", "px", "the same, **up** from the centre of the bottom row", True),
        Variable("frame_rate_hz", "-", "Hz", "frames per second", True),
        Variable("bits", "-", "", "of the camera", True),
        Variable("camera", "-", "", "JSON: the camera that was simulated", True),
        *ORIGIN,
    ),
)  # fmt: skip
UNITS = {v.name: v.units for v in SCHEMA.root if v.dims != "-"}


def open_recording_file(path: Path) -> h5py.File:
    """The file of a recording, to be read frame by frame.

    FileNotFoundError or ValueError in one sentence where it is missing, damaged, of another format or version, or not whole.
    """
    check_whole(path)
    check_walkable(path)
    try:
        file = h5py.File(path, "r")
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: no such file") from None
    except OSError as error:
        raise ValueError(f"{path}: not a readable HDF5 file ({one_line(error)})") from error
    try:
        check_version(file.attrs, path, SCHEMA.format, SCHEMA.version, SCHEMA.remedy)
        for variable in SCHEMA.root:
            if variable.dims == "-" or (variable.optional and variable.name not in file):
                continue
            dataset = file.get(variable.name)
            if not isinstance(dataset, h5py.Dataset) or dataset.ndim not in map(
                len, (variable.axes, variable.least_axes)
            ):
                raise StageError(
                    f"{path}: no variable {variable.name!r} over ({variable.dims}); {SCHEMA.remedy}"
                )
    except StageError:
        file.close()
        raise
    except Exception as error:  # of damaged files h5py raises many kinds
        file.close()
        raise ValueError(f"{path}: damaged, or not a recording ({one_line(error, 200)})") from error
    return file


class RecordingWriter(ResumableFile):
    """Writes frames in any order; `finish` gives the file its name.

    shape: (rows, columns); dtype: uint8 or uint16; `n_frames`; `attrs`: root attributes (docs/formats.md); `times` (n_frames,)
    in s, or taken from attrs["frame_rate_hz"]; `mask=True` where `write` will be given masks. An interrupted recording of the
    same shape and attributes is continued. Raises ValueError on bad input.
    """

    ITEM = "frame"

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
        self.shape = (int(shape[0]), int(shape[1]))
        self.dtype = np.dtype(dtype)
        self.n_frames = int(n_frames)
        if self.dtype not in (np.uint8, np.uint16):
            raise ValueError(f"{path}: a recording holds uint8 or uint16 frames, not {self.dtype}")
        if self.n_frames < 1 or min(self.shape) < 1:
            raise ValueError(f"{path}: a recording needs at least one frame of at least one pixel")
        if times is None:
            if "frame_rate_hz" not in attrs:
                raise ValueError(f"{path}: give `times` or attrs['frame_rate_hz'] to a recording")
            times = np.arange(self.n_frames) / float(attrs["frame_rate_hz"])
        self.times = np.asarray(times, float)
        if self.times.shape != (self.n_frames,):
            raise ValueError(
                f"{path}: times have shape {self.times.shape}, expected ({self.n_frames},)"
            )
        self._masked = mask
        identity = [
            self.shape,
            str(self.dtype),
            self.n_frames,
            self.times.tolist(),
            mask,
            dict(attrs),
        ]
        super().__init__(path, self.n_frames, identity, {**attrs, **SCHEMA.label})

    def _create(self) -> None:
        rows, columns = self.shape
        self.axis("time", self.times, UNITS["time"])
        self.axis("row", np.arange(rows, dtype=np.int32), UNITS["row"])
        self.axis("column", np.arange(columns, dtype=np.int32), UNITS["column"])
        size = (self.n_frames, rows, columns)
        self.items("frames", size, self.dtype)
        self.label("frames", ("time", "row", "column"), UNITS["frames"])
        if self._masked:
            self._file.create_dataset(
                "mask",
                size,
                np.uint8,
                chunks=(1, rows, columns),
                compression="gzip",
                compression_opts=1,
            )
            self.label("mask", ("time", "row", "column"), UNITS["mask"])

    def write(self, i: int, frame: np.ndarray, mask: np.ndarray | None = None) -> None:
        """Store frame `i` (row 0 at the top) and its mask (True or 1 = body); on disk when this returns."""
        if frame.shape != self.shape or frame.dtype != self.dtype:
            raise ValueError(
                f"{self.path}: frame {i} is {frame.shape} {frame.dtype}, expected {self.shape} {self.dtype}"
            )
        if (mask is not None) != ("mask" in self._file):
            raise ValueError(f"{self.path}: give a mask with every frame or with none (frame {i})")
        if not 0 <= i < self.n_frames:
            raise ValueError(
                f"{self.path}: frame {i} is outside the recording's {self.n_frames} frames"
            )
        masks = {} if mask is None else {"mask": np.asarray(mask).astype(bool).astype(np.uint8)}
        self.store(i, {"frames": frame, **masks})

    def add(
        self, name: str, dims: Sequence[str], values: np.ndarray, units: str, **attrs: Any
    ) -> None:
        """Store a further variable, e.g. "outline" or "truth/u"; new dimensions are made from its shape.

        `dims` names one dimension per axis of `values`; a 1-D variable named like its only dimension is a
        coordinate and must come before the variables that use it. An existing variable is replaced.
        """
        values = np.asarray(values)
        if values.ndim != len(dims):
            raise ValueError(
                f"{self.path}: {name} has {values.ndim} axes but {len(dims)} dimensions"
            )
        if name in self._file:
            if tuple(dims) == (name,):
                self._file[name][...] = values
                return
            del self._file[name]
        if tuple(dims) == (name,):
            self.axis(name, values, units)
            return
        for dim, size in zip(dims, values.shape, strict=True):
            if dim not in self._file:
                self.axis(dim, np.arange(size, dtype=np.int32))
            elif self._file[dim].shape != (size,):
                raise ValueError(
                    f"{self.path}: dimension {dim} of {name} is {size}, in the file {self._file[dim].shape[0]}"
                )
        chunks = (1, *values.shape[1:]) if dims[0] == "time" and values.ndim > 2 else None
        squeeze = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if chunks else {}
        self._file.create_dataset(name, data=values, chunks=chunks, **squeeze)
        self.label(name, dims, units)
        for key, value in attrs.items():
            self._file[name].attrs[key] = attribute(value)
        self._file.flush()
