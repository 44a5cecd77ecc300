"""The project's own recordings, images.h5."""

from pathlib import Path

import numpy as np
from numpy import ndarray

from piv.files.errors import one_line
from piv.formats.plane_series import FINGER_VARIABLES
from piv.formats.recording import CAMERA, open_recording_file
from piv.images.recording import LARGEST_CHUNK, Recording, UnreadableFrame

# of damaged files
_HDF5_ERRORS = (OSError, RuntimeError, KeyError, ValueError, TypeError, MemoryError, AttributeError)
_ATTRIBUTES = (*CAMERA, "bits", "camera", "seed", "tip_width")


class RecordingFile(Recording):
    """The project's own `images.h5` (docs/formats.md)."""

    def __init__(self, path: Path) -> None:
        self._file = open_recording_file(path)
        try:
            count = self._checked()
            super().__init__(str(path), count)
            self.files = (path,)
            known = {k: v for k, v in self._file.attrs.items() if k in _ATTRIBUTES}
            self.attrs = {k: v.item() if isinstance(v, np.generic) else v for k, v in known.items()}
            self._check_attributes()
            self.finger = {
                name: self._file[name].shape[1:] for name in FINGER_VARIABLES if name in self._file
            }
            if "time" in self._file:
                self.times = self._numbers("time", (count,))
        except _HDF5_ERRORS as error:
            self._file.close()
            raise ValueError(
                f"{path}: damaged, or not a recording ({one_line(error, 200)})"
            ) from error

    def _checked(self) -> int:
        """Number of frames; ValueError where they cannot be read one by one."""
        frames = self._file["frames"]
        if 0 in frames.shape or frames.dtype not in (np.uint8, np.uint16):
            raise ValueError(
                f"frames are {frames.shape} {frames.dtype}, "
                "expected (time, row, column) of uint8 or uint16"
            )
        if "mask" in self._file and (
            self._file["mask"].shape != frames.shape or self._file["mask"].dtype.kind not in "uib"
        ):
            raise ValueError(f"the masks are {self._file['mask'].shape}, the frames {frames.shape}")
        if frames.chunks is not None and np.prod(frames.chunks) > LARGEST_CHUNK:
            raise ValueError(f"chunks of {frames.chunks} are too large to read frame by frame")
        return int(frames.shape[0])

    def _check_attributes(self) -> None:
        for key in CAMERA:
            value = self.attrs.get(key, 1.0)
            if not isinstance(value, int | float) or not np.isfinite(value):
                raise ValueError(f"attribute {key} is {value!r}, expected a number")
            if not key.startswith("origin") and not value > 0:
                raise ValueError(f"attribute {key} is {value!r}, expected a positive number")

    def _numbers(self, name: str, shape: tuple[int, ...]) -> ndarray:
        values = np.asarray(self._file[name][...], float)
        if values.shape != shape or not np.isfinite(values).all():
            raise ValueError(f"{name} has shape {values.shape}, expected {shape} finite numbers")
        return values

    def _read(self, i: int) -> ndarray:
        return self._part("frames", i, self.frame_name(i))

    def mask(self, i: int) -> ndarray | None:
        """The stored mask of frame `i`, True = body, or None."""
        if "mask" not in self._file:
            return None
        return self._part("mask", i, self.frame_name(i)).astype(bool)

    def variable(self, name: str, frames: slice) -> ndarray:
        """A variable of `finger` at some frames (frame, ...)."""
        return self._part(name, frames, f"{self.name}: {name}")

    def _part(self, name: str, where: int | slice, place: str) -> ndarray:
        try:
            return self._file[name][where]
        except _HDF5_ERRORS as error:
            raise UnreadableFrame(f"{place}: cannot be read ({one_line(error)})") from error

    def close(self) -> None:
        """Close the file."""
        self._file.close()
