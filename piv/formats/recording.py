"""Recordings, `images.h5` (docs/formats.md): one chunk per frame, written resumably."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
from numpy import ndarray

from piv.files.errors import StageError, one_line
from piv.files.hdf5 import open_hdf5
from piv.files.provenance import check_version
from piv.files.resumable_file import ResumableFile
from piv.files.schema import Schema, variables
from piv.formats.plane_series import FINGERS, ORIGIN, REMEDY

SCHEMA = Schema(
    "recording",
    variables("""
time  time  s  of each frame; with `pairs_every` > 1 of `camera`, two frames out of every so many
row  row  px  from the top
column  column  px  from the left
frames  time, row, column  1  uint8 or uint16, **row 0 at the top** as a camera writes it
mask?  time, row, column  1  uint8, 1 = body
""")
    + FINGERS
    + variables("""
scale_mm_per_px?  -  mm/px  size of a pixel in the light sheet
origin_x_px?  -  px  the tank frame's origin, right of the centre of the left column
origin_y_px?  -  px  the same, **up** from the centre of the bottom row
frame_rate_hz?  -  Hz  frames per second
bits?  -  -  of the camera
camera?  -  -  JSON: the camera that was simulated
""")
    + ORIGIN,
    remedy=REMEDY,
)
UNITS = {v.name: v.units for v in SCHEMA.root if v.dims != "-"}
_DIMS = ("time", "row", "column")
CAMERA = ("scale_mm_per_px", "origin_x_px", "origin_y_px", "frame_rate_hz")


def pixel_of(attrs: Mapping[str, Any]) -> float | None:
    """Size of a pixel in the sheet (m) by the attributes of a recording or of its vectors."""
    scale = attrs.get("scale_mm_per_px")
    return None if scale is None else float(scale) * 1e-3


def window_of(plane: xr.Dataset) -> float:
    """Side of the correlation window in the plane's unit, from its settings; 0 where unknown."""
    try:
        window = float(json.loads(plane.attrs["settings"])["window"])
    except (KeyError, TypeError, ValueError):
        return 0.0
    if plane["x"].attrs.get("units") == "px":
        return window
    return window * (pixel_of(plane.attrs) or 0.0)


def open_recording_file(path: Path) -> h5py.File:
    """The file of a recording, to be read frame by frame.

    FileNotFoundError or ValueError where it is missing, damaged, incomplete or another format.
    """
    file = open_hdf5(path)
    try:
        check_version(file.attrs, path, SCHEMA.format, SCHEMA.version, SCHEMA.remedy)
        for variable in SCHEMA.root:
            if variable.dims == "-" or (variable.optional and variable.name not in file):
                continue
            dataset = file.get(variable.name)
            sizes = len(variable.axes), len(variable.least_axes)
            if not isinstance(dataset, h5py.Dataset) or dataset.ndim not in sizes:
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
    """Frames of a recording in any order; `finish` renames the file.

    shape: (rows, columns); dtype: uint8 or uint16; attrs: root attributes (docs/formats.md); times
    (n_frames,) in s, by default from attrs["frame_rate_hz"]; mask: `write` takes masks. A recording
    of the same shape and attributes is continued. ValueError on bad input.
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
        times: Sequence[float] | ndarray | None = None,
        mask: bool = False,
    ) -> None:
        self.shape = (int(shape[0]), int(shape[1]))
        self.dtype = np.dtype(dtype)
        if self.dtype not in (np.uint8, np.uint16):
            raise ValueError(f"{path}: a recording holds uint8 or uint16 frames, not {self.dtype}")
        if times is None:
            if "frame_rate_hz" not in attrs:
                raise ValueError(f"{path}: give `times` or attrs['frame_rate_hz'] to a recording")
            times = np.arange(n_frames) / float(attrs["frame_rate_hz"])
        self.times = np.asarray(times, float)
        if self.times.shape != (n_frames,):
            raise ValueError(f"{path}: times have shape {self.times.shape}, expected ({n_frames},)")
        self._masked = mask
        identity = [
            self.shape, str(self.dtype), n_frames, self.times.tolist(), mask, dict(attrs)
        ]  # fmt: skip
        super().__init__(path, n_frames, identity, {**attrs, **SCHEMA.label})

    def _create(self) -> None:
        self.axis("time", self.times, UNITS["time"])
        for name, size in zip(("row", "column"), self.shape, strict=True):
            self.axis(name, np.arange(size, dtype=np.int32), UNITS[name])
        self.add_items("frames", _DIMS, UNITS["frames"], self.dtype)
        if self._masked:
            self._file.create_dataset(
                "mask",
                (self.count, *self.shape),
                np.uint8,
                chunks=(1, *self.shape),
                compression="gzip",
                compression_opts=1,
            )
            self.label("mask", _DIMS, UNITS["mask"])

    def write(self, i: int, frame: ndarray, mask: ndarray | None = None) -> None:
        """Store frame `i` (row 0 at the top) and its mask (True or 1 = body); then on disk."""
        if frame.shape != self.shape or frame.dtype != self.dtype:
            raise ValueError(
                f"{self.path}: frame {i} is {frame.shape} {frame.dtype}, expected"
                f" {self.shape} {self.dtype}"
            )
        if (mask is not None) != self._masked:
            raise ValueError(f"{self.path}: give a mask with every frame or with none (frame {i})")
        if not 0 <= i < self.count:
            raise ValueError(f"{self.path}: frame {i} is outside the {self.count} frames")
        masks = {} if mask is None else {"mask": np.asarray(mask).astype(bool).astype(np.uint8)}
        self.store(i, {"frames": frame, **masks})

    def add(self, name: str, dims: Sequence[str], values: ndarray, units: str) -> None:
        """Add or replace a further variable, as "outline", over `dims`; new ones are numbered."""
        self._add(name, dims, values.shape, [values], units)
