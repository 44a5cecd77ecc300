"""One class per kind of recording; each reads a frame when it is asked for and keeps none of the rest."""

from __future__ import annotations

import os
import struct
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np

from piv.errors import one_line
from piv.hdf5_check import check_walkable

COLOURS = ("refuse", "luma", "green")
HDF5_ERRORS = (
    OSError,
    RuntimeError,
    KeyError,
    ValueError,
    TypeError,
    MemoryError,
    AttributeError,
)  # of damaged files
LARGEST_CHUNK = 2**28  # px that reading one frame may bring into memory
RECENT_FRAMES = 8  # of a video, so that neighbouring pairs need no seeking
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # each failure becomes one sentence of ours
ATTRIBUTES = ("bits", "scale_m_per_px", "origin_x_px", "origin_y_px", "frame_rate_hz", "camera", "seed")


class Recording:
    """Frames of equal size, read one by one.

    `len(rec)`; `rec.shape` (rows, columns); `rec.frame(i)`: 2-D uint8 or uint16, row 0 at the top;
    `rec.mask(i)`: 2-D bool, True = body, or None; `rec.times`: (n,) s, or None where the frame rate is
    unknown; `rec.attrs`: what is known of `bits`, `scale_m_per_px`, `origin_x_px`, `origin_y_px`,
    `frame_rate_hz`. A context manager. Frames raise ValueError where they cannot be read.
    """

    def __init__(self, name: str, count: int, frame_rate_hz: float | None) -> None:
        if frame_rate_hz is not None and not frame_rate_hz > 0:
            raise ValueError(f"{name}: frame_rate_hz must be positive, got {frame_rate_hz}")
        self.name = name
        self.count = count
        self.attrs: dict[str, Any] = {}
        self.times: np.ndarray | None = None
        if frame_rate_hz is not None:
            self.attrs["frame_rate_hz"] = float(frame_rate_hz)
            self.times = np.arange(count) / float(frame_rate_hz)
        self._shape: tuple[int, int] | None = None

    def __len__(self) -> int:
        return self.count

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns) of every frame."""
        if self._shape is None:
            self.frame(0)
        assert self._shape is not None
        return self._shape

    def frame(self, i: int) -> np.ndarray:
        """Frame `i`, 2-D, native dtype, row 0 at the top."""
        if not 0 <= i < self.count:
            raise IndexError(f"{self.name}: frame {i} is outside the recording's {self.count} frames")
        image = self._read(i)
        if self._shape is None:
            self._shape = (image.shape[0], image.shape[1])
            self.attrs.setdefault("bits", 8 * image.dtype.itemsize)
        elif image.shape != self._shape:
            raise ValueError(
                f"{self._frame_name(i)}: {image.shape[1]}x{image.shape[0]} px, "
                f"but the recording began with {self._shape[1]}x{self._shape[0]} px"
            )
        return image

    def mask(self, i: int) -> np.ndarray | None:
        """The body in frame `i` where the recording knows it."""
        return None

    def __iter__(self) -> Iterator[np.ndarray]:
        return (self.frame(i) for i in range(self.count))

    def _read(self, i: int) -> np.ndarray:
        raise NotImplementedError

    def _frame_name(self, i: int) -> str:
        return f"{self.name}: frame {i}"

    def close(self) -> None:
        """Release files; frames cannot be read afterwards."""

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def to_grey(image: np.ndarray, colour: str, name: str) -> np.ndarray:
    """2-D uint8/uint16 from a decoded image: equal colour channels are one; an alpha channel is ignored.

    Really coloured images need a rule: "luma" (Rec. 601) or "green" (the sharpest channel of a Bayer
    sensor under green laser light); with "refuse" they raise ValueError.
    """
    if colour not in COLOURS:
        raise ValueError(f"colour must be one of {', '.join(COLOURS)}, got {colour!r}")
    if image.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"{name}: pixels are {image.dtype}; convert to 8 or 16 bit unsigned integers")
    if image.ndim == 2:
        return image
    if image.shape[2] < 3:  # grey and alpha
        return image[:, :, 0]
    blue, green, red = image[:, :, 0], image[:, :, 1], image[:, :, 2]
    if np.array_equal(blue, green) and np.array_equal(red, green):
        return np.ascontiguousarray(green)
    if colour == "luma":
        return cv2.cvtColor(np.ascontiguousarray(image[:, :, :3]), cv2.COLOR_BGR2GRAY)
    if colour == "green":
        return np.ascontiguousarray(green)
    raise ValueError(f"{name}: a colour image; say with colour 'luma' or 'green' how to make it grey")


class ImageFiles(Recording):
    """Image files in the order given, TIFF stacks page by page (8 to 16 bit; 10 and 12 bit in 16)."""

    def __init__(
        self, paths: Sequence[Path], *, frame_rate_hz: float | None = None, colour: str = "refuse"
    ) -> None:
        pages = [(p, k) for p in paths for k in range(_page_count(p))]
        super().__init__(_common_name(paths), len(pages), frame_rate_hz)
        self.pages = pages
        self.colour = colour

    def _frame_name(self, i: int) -> str:
        path, page = self.pages[i]
        return f"{path}: page {page}" if page else str(path)

    def _read(self, i: int) -> np.ndarray:
        path, page = self.pages[i]
        try:
            done, images = cv2.imreadmulti(str(path), start=page, count=1, flags=cv2.IMREAD_UNCHANGED)
        except cv2.error:
            done, images = False, ()
        if not done or not len(images):
            raise ValueError(f"{self._frame_name(i)}: not readable as an image (damaged, or another format)")
        return to_grey(images[0], self.colour, self._frame_name(i))


def _page_count(path: Path) -> int:
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    suffix = path.suffix.lower()
    if suffix in (".jpg", ".jpeg") and b"\xff\xd9" not in path.read_bytes()[-1024:]:
        raise ValueError(f"{path}: the JPEG image is cut off")  # OpenCV would fill the rest with grey
    return tiff_pages(path) if suffix in (".tif", ".tiff") else 1


def tiff_pages(path: Path) -> int:
    """Number of pages by the chain of directories (TIFF 6.0, BigTIFF); ValueError where the chain is broken.

    OpenCV's own count stops silently at a break, so that half a stack would pass for a whole one.
    """
    size = path.stat().st_size
    broken = ValueError(f"{path}: not readable as a TIFF image (damaged, or another format)")
    with path.open("rb") as file:
        head = file.read(16)
        order = {b"II": "<", b"MM": ">"}.get(head[:2])
        if order is None or len(head) < 8:
            raise broken
        big = struct.unpack(order + "H", head[2:4])[0] == 43
        count_code, entry, link_code = (
            (order + "Q", 20, order + "Q") if big else (order + "H", 12, order + "I")
        )
        count_size, link_size = struct.calcsize(count_code), struct.calcsize(link_code)
        link = head[8:16] if big else head[4:8]
        seen: set[int] = set()
        while (offset := struct.unpack(link_code, link)[0]) != 0:
            file.seek(offset)
            number = file.read(count_size)
            if offset in seen or len(number) < count_size:
                raise broken
            seen.add(offset)
            end = offset + count_size + struct.unpack(count_code, number)[0] * entry
            file.seek(end)
            link = file.read(link_size)
            if end + link_size > size or len(link) < link_size:
                raise broken
    if not seen:
        raise broken
    return len(seen)


def _common_name(paths: Sequence[Path]) -> str:
    return str(paths[0]) if len(paths) == 1 else f"{paths[0]} ... {paths[-1].name}"


class Video(Recording):
    """A video through OpenCV: 8 bit; colour becomes luma, because video codecs store luma in full resolution.

    Frames are decoded in order; going back further than a few frames decodes from the start again, because
    seeking by number is not exact in every container.
    """

    def __init__(self, path: Path, *, frame_rate_hz: float | None = None) -> None:
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # our one sentence is enough
        self.path = path
        self._open()
        count = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        if count < 1:
            raise ValueError(f"{path}: a video without frames, or whose container does not say how many")
        played = self._capture.get(cv2.CAP_PROP_FPS)
        super().__init__(str(path), count, frame_rate_hz)
        # A high-speed film is usually stored with a playing rate, not with the camera's: never taken as time.
        self.attrs["playing_rate_hz"] = float(played)

    def _open(self) -> None:
        if not self.path.is_file():
            raise FileNotFoundError(f"{self.path}: no such file")
        if self.path.stat().st_size == 0:
            raise ValueError(f"{self.path}: the file is empty")
        self._capture = cv2.VideoCapture(str(self.path))
        if not self._capture.isOpened():
            raise ValueError(f"{self.path}: not readable as a video (damaged, or an unknown codec)")
        self._next = 0
        self._recent: OrderedDict[int, np.ndarray] = OrderedDict()

    def _read(self, i: int) -> np.ndarray:
        if i in self._recent:
            return self._recent[i]
        if i < self._next:
            self._capture.release()
            self._open()
        while self._next <= i:
            if not self._capture.grab():
                raise ValueError(
                    f"{self.path}: decoding ended before frame {i}, though the container says {self.count} frames"
                )
            self._next += 1
            if self._next > i - RECENT_FRAMES:
                _, image = self._capture.retrieve()
                self._recent[self._next - 1] = to_grey(image, "luma", str(self.path))
            while len(self._recent) > RECENT_FRAMES:
                self._recent.popitem(last=False)
        return self._recent[i]

    def close(self) -> None:
        """Close the video."""
        self._capture.release()


class Photron(Recording):
    """A Photron recording, `.mraw` beside `.cihx` or `.cih`: 8, 12 (packed) or 16 bit, mapped, not loaded."""

    def __init__(self, path: Path, *, frame_rate_hz: float | None = None) -> None:
        import pyMRAW  # compiles at import: only who needs it waits

        header, self.path = _photron_files(path)
        try:
            cih = pyMRAW.get_cih(str(header))
            self._size = (int(cih["Image Height"]), int(cih["Image Width"]))
            count, self.bits = int(cih["Total Frame"]), int(cih["Color Bit"])
            rate = float(cih["Record Rate(fps)"])
        except Exception as error:  # the parser raises whatever its parts raise
            raise ValueError(f"{header}: not a readable Photron header ({one_line(error)})") from error
        if str(cih.get("File Format", "MRaw")).lower() != "mraw" or self.bits not in (8, 12, 16):
            raise ValueError(
                f"{header}: {cih.get('File Format')} of {self.bits} bit; only MRaw of 8, 12 or 16 bit can be read"
            )
        pixels = self._size[0] * self._size[1]
        need, size = count * pixels * self.bits // 8, self.path.stat().st_size
        if count < 1 or size < need:
            raise ValueError(
                f"{self.path}: {size} bytes, but {header.name} announces {count} frames, {need} bytes"
            )
        super().__init__(str(self.path), count, frame_rate_hz or rate)
        self._unpack = pyMRAW.nb_read_uint12
        self.attrs["bits"] = int(cih.get("EffectiveBit Depth", self.bits)) if self.bits != 8 else 8
        self.attrs["camera"] = {k: cih[k] for k in ("Camera Type", "Shutter Speed(s)") if k in cih}
        if self.bits == 12 and pixels % 2:
            raise ValueError(f"{header}: packed 12-bit frames need an even number of pixels, got {pixels}")

    def _read(self, i: int) -> np.ndarray:
        pixels = self._size[0] * self._size[1]
        nbytes = pixels * self.bits // 8
        data = np.fromfile(self.path, np.uint8, nbytes, offset=i * nbytes)
        if self.bits == 12:
            data.flags.writeable = False  # the compiled signature asks for a read-only array
            return self._unpack(data).reshape(self._size)
        return data.view(np.dtype("<u2") if self.bits == 16 else np.uint8).reshape(self._size)


def _photron_files(path: Path) -> tuple[Path, Path]:
    headers = [path] if path.suffix.lower() != ".mraw" else [path.with_suffix(s) for s in (".cihx", ".cih")]
    header = next((h for h in headers if h.is_file()), None)
    raw = path.with_suffix(".mraw")
    if header is None:
        raise FileNotFoundError(f"{path}: no {path.stem}.cihx or .cih beside it, which says the image size")
    if not raw.is_file():
        raise FileNotFoundError(f"{header}: no {raw.name} beside it, which holds the frames")
    return header, raw


class RecordingFile(Recording):
    """The project's own `images.h5` (docs/formats.md)."""

    def __init__(self, path: Path, *, frame_rate_hz: float | None = None) -> None:
        check_walkable(path)
        try:
            self._file = h5py.File(path, "r")
        except FileNotFoundError:
            raise FileNotFoundError(f"{path}: no such file") from None
        except OSError as error:
            raise ValueError(f"{path}: not a readable HDF5 file ({one_line(error)})") from error
        try:
            count = self._checked()
            super().__init__(str(path), count, frame_rate_hz)
            self.attrs = {k: _scalar(v) for k, v in self._file.attrs.items() if k in ATTRIBUTES} | self.attrs
            self._check_attributes()
            if frame_rate_hz is None and "time" in self._file:
                self.times = self._numbers("time", (count,))
        except HDF5_ERRORS as error:
            self._file.close()
            raise ValueError(f"{path}: damaged, or not a recording ({one_line(error, 200)})") from error

    def _checked(self) -> int:
        """Number of frames; ValueError where the file holds no recording."""
        kind = self._file.attrs.get("format")
        if kind != "recording" or "frames" not in self._file:
            raise ValueError(f"format is {kind!r}, expected 'recording' with frames (time, row, column)")
        frames = self._file["frames"]
        if frames.ndim != 3 or 0 in frames.shape or frames.dtype not in (np.uint8, np.uint16):
            raise ValueError(
                f"frames are {frames.shape} {frames.dtype}, expected (time, row, column) of uint8 or uint16"
            )
        if "mask" in self._file and (
            self._file["mask"].shape != frames.shape or self._file["mask"].dtype.kind not in "uib"
        ):
            raise ValueError(f"the masks are {self._file['mask'].shape}, the frames {frames.shape}")
        if frames.chunks is not None and np.prod(frames.chunks) > LARGEST_CHUNK:
            raise ValueError(f"chunks of {frames.chunks} are too large to read frame by frame")
        return int(frames.shape[0])

    def _check_attributes(self) -> None:
        for key in ("scale_m_per_px", "origin_x_px", "origin_y_px", "frame_rate_hz"):
            value = self.attrs.get(key, 1.0)
            if not isinstance(value, int | float) or not np.isfinite(value):
                raise ValueError(f"attribute {key} is {value!r}, expected a number")
            if key in ("scale_m_per_px", "frame_rate_hz") and not value > 0:
                raise ValueError(f"attribute {key} is {value!r}, expected a positive number")

    def _numbers(self, name: str, shape: tuple[int, ...]) -> np.ndarray:
        values = np.asarray(self._file[name][...], float)
        if values.shape != shape or not np.isfinite(values).all():
            raise ValueError(f"{name} has shape {values.shape}, expected {shape} finite numbers")
        return values

    def _read(self, i: int) -> np.ndarray:
        return self._part("frames", i)

    def mask(self, i: int) -> np.ndarray | None:
        """The stored mask of frame `i`, True = body, or None."""
        return self._part("mask", i).astype(bool) if "mask" in self._file else None

    def _part(self, name: str, i: int) -> np.ndarray:
        try:
            return self._file[name][i]
        except HDF5_ERRORS as error:
            raise ValueError(f"{self._frame_name(i)}: cannot be read ({one_line(error)})") from error

    def variable(self, name: str) -> np.ndarray | None:
        """A further variable, such as `outline` or `tip`, whole; None where the file has none."""
        return self._file[name][...] if name in self._file else None

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _scalar(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value
