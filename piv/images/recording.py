"""Recordings: each kind reads a frame on demand and keeps no others in memory."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

import cv2
from numpy import ndarray

LARGEST_CHUNK = 2**28  # px that reading one frame may bring into memory
# each failure becomes one sentence of ours
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


class UnreadableFrame(ValueError):
    """A frame whose file is missing or damaged; others of the recording may be whole."""


class Recording:
    """Frames of equal size, read one by one.

    `len(rec)`; `rec.shape` (rows, columns); `rec.frame(i)`: 2-D uint8, uint16 or float32, row 0 at
    the top; `rec.mask(i)`: 2-D bool, True = body, or None; `rec.times`: (n,) s, or None where they
    are not known, to be set then; `rec.attrs`: what is known of `bits` and of
    `piv.formats.recording.CAMERA`. A context manager. Frames raise ValueError where they cannot
    be read.
    """

    def __init__(self, name: str, count: int) -> None:
        self.name = name
        self.count = count
        self.attrs: dict[str, Any] = {}
        self.times: ndarray | None = None
        self.interval: float | None = None  # s between the exposures of a pair, where times lack
        self.pairing: str | None = "1-2,2-3"  # by the frames' names; None: `pairing_doubt` asks
        self.pairing_doubt = ""
        self.lossy = False  # saved in a format that leaves out detail
        # of the lower left pixel, in the picture that coordinates refer to
        self.corner_px = (0.0, 0.0)
        self.key: Any = None  # of what is not in the frames: masks, region
        self.files: tuple[Path, ...] = ()  # that the frames are in
        self.missing: frozenset[int] = frozenset()  # frames between others that have no file
        # shape per frame of the finger variables, which `variable` reads
        self.finger: dict[str, tuple[int, ...]] = {}
        self._shape: tuple[int, int] | None = None

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}: {self.count} frames>"

    def __len__(self) -> int:
        return self.count

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns) of every frame."""
        if self._shape is None:
            self.frame(0)
        assert self._shape is not None
        return self._shape

    def frame(self, i: int) -> ndarray:
        """Frame `i`, 2-D, native dtype, row 0 at the top."""
        if not 0 <= i < self.count:
            raise IndexError(
                f"{self.name}: frame {i} is outside the recording's {self.count} frames"
            )
        image = self._read(i)
        if image.size > LARGEST_CHUNK:
            raise ValueError(
                f"{self.frame_name(i)}: {image.shape[1]}x{image.shape[0]} px are more than PIV"
                f" takes, {LARGEST_CHUNK / 1e6:.0f} million; cut the pictures to the part of"
                " interest, or make them smaller"
            )
        if self._shape is None:
            self._shape = (image.shape[0], image.shape[1])
            if image.dtype.kind == "u":
                self.attrs.setdefault("bits", 8 * image.dtype.itemsize)
        elif image.shape != self._shape:
            raise ValueError(
                f"{self.frame_name(i)}: {image.shape[1]}x{image.shape[0]} px, but the recording "
                f"began with {self._shape[1]}x{self._shape[0]} px; give pictures of one size"
            )
        return image

    def mask(self, i: int) -> ndarray | None:
        """The body in frame `i` where the recording knows it."""
        return None

    def variable(self, name: str, frames: slice) -> ndarray:
        """A variable of `finger` at some frames (frame, ...)."""
        raise NotImplementedError

    def __iter__(self) -> Iterator[ndarray]:
        return (self.frame(i) for i in range(self.count))

    def _read(self, i: int) -> ndarray:
        raise NotImplementedError

    def frame_name(self, i: int) -> str:
        """What a message calls frame `i`."""
        return f"{self.name}: frame {i}"

    @property
    def stamp(self) -> list[tuple[str, int, int]]:
        """Name, bytes and time of change (ns) of each file: other where a picture is replaced."""
        stats = [(str(path), path.stat()) for path in self.files if path.exists()]
        return [(name, stat.st_size, stat.st_mtime_ns) for name, stat in stats]

    def close(self) -> None:
        """Release files; frames cannot be read afterwards."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
