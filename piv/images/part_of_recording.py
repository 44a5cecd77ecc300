"""A recording with masks (one for all frames, one each, or moving polygons), cut to a region."""

import glob
import hashlib
import json
import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from piv.files.errors import one_line
from piv.formats.recording import pixel_of
from piv.images.image_files import ImageFiles
from piv.images.masks import not_whole, outline_px, polygons_mask, read_mask
from piv.images.open_recording import IMAGE_SUFFIXES, open_recording, row_to_y_px
from piv.images.recording import Recording

_POLYGON_KEYS = {"format", "format_version", "unit", "roi", "bodies"}


@dataclass(frozen=True)
class _Masks:
    """`of(i)`: mask of frame i (bool, image order, True = body); `key`: identity; `roi`: px."""

    of: Callable[[int], ndarray]
    key: Any
    roi: tuple[float, float, float, float] | None = None


class _PartOfRecording(Recording):
    """Frames of another recording within a region (px, y up, ends included), with further masks.

    `corner_px`: the region's lower left pixel in the whole picture, whose coordinates results keep.
    """

    def __init__(
        self, whole: Recording, masks: _Masks | None, roi: tuple[float, float, float, float] | None
    ) -> None:
        super().__init__(whole.name, len(whole))
        self.whole, self.masks = whole, masks
        self.attrs, self.times, self.interval = whole.attrs, whole.times, whole.interval
        self.pairing, self.pairing_doubt = whole.pairing, whole.pairing_doubt
        self.finger, self.files, self.missing = whole.finger, whole.files, whole.missing
        rows, columns = whole.shape
        x0, y0, x1, y1 = roi or (0, 0, columns - 1, rows - 1)
        left, bottom = max(0, math.ceil(x0)), max(0, math.ceil(y0))
        right, top = min(columns - 1, math.floor(x1)), min(rows - 1, math.floor(y1))
        first, last = int(row_to_y_px(top, rows)), int(row_to_y_px(bottom, rows))
        self.cut = (slice(first, last + 1), slice(left, right + 1))
        self.corner_px = (float(left), float(bottom))
        self.key: Any = [
            *([whole.key] if whole.key is not None else []),
            None if masks is None else masks.key,
            None if roi is None else [left, bottom, right, top],
        ]

    def _read(self, i: int) -> ndarray:
        return np.ascontiguousarray(self.whole.frame(i)[self.cut])

    def mask(self, i: int) -> ndarray | None:
        """The body in frame `i`: the recording's own and the further masks."""
        own = self.whole.mask(i)
        if self.masks is not None:
            own = self.masks.of(i) if own is None else self.masks.of(i) | own
        return None if own is None else np.ascontiguousarray(own[self.cut])

    def frame_name(self, i: int) -> str:
        """What a message calls frame `i`."""
        return self.whole.frame_name(i)

    def variable(self, name: str, frames: slice) -> ndarray:
        """A variable of `finger` at some frames (frame, ...)."""
        return self.whole.variable(name, frames)

    def close(self) -> None:
        """Close the whole recording."""
        self.whole.close()


def part_of_recording(
    recording: Recording,
    mask: str | Path | ndarray | None = None,
    roi: tuple[float, ...] | None = None,
    *,
    roi_unit: str = "px",
) -> Recording:
    """Cut a recording to a region, and add masks to it.

    Parameters
    ----------
    recording
        As of `open_recording`.
    mask
        An array (bool, image order, true = body), a polygon (.csv, .txt) or an image, for all
        frames; a folder, a pattern or a TIFF stack, one image per frame, as `piv mask` writes them;
        .json or .toml, polygons that move (docs/piv_guide.md).
    roi
        Region x0, y0, x1, y1, y up.
    roi_unit
        "px" or "m" of the region.

    Returns
    -------
    Recording
        Its vectors keep the coordinates of the whole picture.

    Raises
    ------
    ValueError, FileNotFoundError
        Where the masks do not fit, or the region leaves the picture.

    Examples
    --------
    >>> with piv.open_recording("docs/tutorials/frames") as film:
    ...     piv.part_of_recording(film, roi=(10, 10, 109, 89)).shape
    (80, 100)
    """
    if roi_unit not in ("px", "m"):
        raise ValueError(f"`roi_unit` must be px or m, got {roi_unit!r}")
    masks = _open_masks(mask, recording) if mask is not None else None
    if roi is not None and masks is not None and masks.roi is not None:
        raise ValueError(f"{mask}: this file holds a region of interest too; give one of the two")
    region = _roi_px(roi, roi_unit, recording) if roi is not None else masks.roi if masks else None
    if masks is None and region is None:
        return recording
    part = _PartOfRecording(recording, masks, region)
    if masks is not None and (first := part.mask(0)) is not None:
        not_whole(first, mask if isinstance(mask, (str, Path)) else "the mask")
    return part


def _open_masks(source: str | Path | ndarray, recording: Recording) -> _Masks:
    if isinstance(source, ndarray):
        return _still(source.astype(bool), "the mask", recording)
    path = Path(source)
    suffix = path.suffix.lower()
    if path.is_file() and suffix in (".json", ".toml"):
        return _polygons(path, recording)
    if (
        path.is_dir()
        or (glob.has_magic(str(source)) and not path.exists())
        or suffix in (".tif", ".tiff")
    ):
        return _images(str(source), recording)
    return _still(read_mask(path, recording.shape), str(path), recording)


def _still(mask: ndarray, name: str, recording: Recording) -> _Masks:
    if mask.shape != recording.shape:
        raise ValueError(f"{name}: of shape {mask.shape}, the frames are {recording.shape}")
    return _Masks(lambda i: mask, hashlib.sha256(np.packbits(mask).tobytes()).hexdigest())


def _images(source: str, recording: Recording) -> _Masks:
    images = open_recording(source)
    if not isinstance(images, ImageFiles):
        raise ValueError(f"{source}: masks are images ({' '.join(IMAGE_SUFFIXES)}), one per frame")
    count, frames = len(images), len(recording)
    if count not in (1, frames):
        raise ValueError(
            f"{source}: {count} masks for {frames} frames; 'piv mask' makes one per frame, "
            "or give one for all"
        )
    if images.shape != recording.shape:
        (rows, columns), (high, wide) = images.shape, recording.shape
        raise ValueError(
            f"{source}: the masks are {columns}x{rows} px, the frames are {wide}x{high} px; "
            "make them of these frames"
        )
    files = [(str(p), k, p.stat().st_size, p.stat().st_mtime_ns) for p, k in images.pages]
    return _Masks(lambda i: images.frame(i if count > 1 else 0) > 0, files)


def _polygons(path: Path, recording: Recording) -> _Masks:
    try:
        text = path.read_text(encoding="utf-8")
        content = tomllib.loads(text) if path.suffix.lower() == ".toml" else json.loads(text)
        if not isinstance(content, dict):
            raise ValueError("it is no table of keys and values")
        if unknown := sorted(set(content) - _POLYGON_KEYS):
            raise ValueError(
                f"unknown key {unknown[0]!r}; known are {', '.join(sorted(_POLYGON_KEYS))}"
            )
        unit = content.get("unit", "px")
        if unit not in ("px", "m"):
            raise ValueError(f"unit is {unit!r}; give 'px' or 'm'")
        bodies = [_corners(body, recording) for body in content.get("bodies", [])]
        roi = content.get("roi")
        if roi is not None:
            roi = _roi_px(tuple(map(float, roi)), unit, recording)
        if not bodies and roi is None:
            raise ValueError("it holds no body and no roi")
    except (
        ValueError,
        TypeError,
        KeyError,
        AttributeError,
        OverflowError,
        RecursionError,
    ) as error:
        raise ValueError(f"{path}: not a file of mask polygons ({one_line(error, 200)})") from None
    if unit == "m":
        bodies = [outline_px(body, *_scale_of(recording)) for body in bodies]
    return _Masks(lambda i: polygons_mask([body[i] for body in bodies], recording.shape), text, roi)


def _corners(body: dict[str, Any], recording: Recording) -> ndarray:
    """Corners (frame, point, 2) of one body in every frame, linear between its instants."""
    if unknown := sorted(set(body) - {"frames", "times", "corners"}):
        raise ValueError(f"unknown key {unknown[0]!r} of a body; known are frames, times, corners")
    if "frames" in body and "times" in body:
        raise ValueError("a body has either frames or times")
    # ValueError where the polygons differ in their number of corners
    corners = np.array(body["corners"], float)
    corners = corners[None] if corners.ndim == 2 else corners
    shaped = corners.ndim == 3 and corners.shape[1] >= 3 and corners.shape[2] == 2
    if not (shaped and np.isfinite(corners).all()):
        raise ValueError(
            f"corners are of shape {corners.shape}; give at least 3 of (x, y), "
            "equally many at each instant"
        )
    instants = np.array(body.get("frames", body.get("times", [0])), float)
    if instants.shape != corners.shape[:1] or not (np.diff(instants) > 0).all():
        raise ValueError(
            f"{instants.size} ascending instants are needed for {len(corners)} polygons"
        )
    if len(corners) == 1:
        return np.repeat(corners, len(recording), axis=0)
    if "times" in body and recording.times is None:
        raise ValueError(
            "its bodies have times, the recording has none; give `interval` or `rate`, or frames"
        )
    at = recording.times if "times" in body else np.arange(len(recording), dtype=float)
    assert at is not None
    if at[0] < instants[0] - 1e-9 or at[-1] > instants[-1] + 1e-9:
        raise ValueError(
            f"a body's polygons run from {instants[0]:g} to {instants[-1]:g}, "
            f"the recording runs from {at[0]:g} to {at[-1]:g}"
        )
    flat = corners.reshape(len(corners), -1)
    return np.stack([np.interp(at, instants, c) for c in flat.T], axis=-1).reshape(
        -1, *corners.shape[1:]
    )


def _scale_of(recording: Recording) -> tuple[float, tuple[float, float]]:
    """Size of a pixel (m) and the origin (px) of a recording; ValueError where it has no scale."""
    pixel = pixel_of(recording.attrs)
    if pixel is None:
        raise ValueError(f"{recording.name}: metres need its scale; give `scale_mm_per_px`, or px")
    return pixel, (
        float(recording.attrs.get("origin_x_px", 0)),
        float(recording.attrs.get("origin_y_px", 0)),
    )


def _roi_px(
    roi: tuple[float, ...], unit: str, recording: Recording
) -> tuple[float, float, float, float]:
    """Corners x0, y0, x1, y1 (px, y up) of a region; ValueError where they leave the picture."""
    if len(roi) != 4 or not np.isfinite(roi).all():
        raise ValueError(f"a region is x0 y0 x1 y1, got {' '.join(map(str, roi))}")
    ends = np.reshape(roi, (2, 2))
    if unit == "m":
        ends = outline_px(ends, *_scale_of(recording))
    (x0, y0), (x1, y1) = ends.tolist()
    rows, columns = recording.shape
    if not (x0 < x1 and y0 < y1):
        raise ValueError(
            f"the region {x0:g} {y0:g} {x1:g} {y1:g} px is empty; give x0 < x1 and y0 < y1, y up"
        )
    if x0 < -0.5 or y0 < -0.5 or x1 > columns - 0.5 or y1 > rows - 0.5:
        raise ValueError(
            f"the region {x0:g} {y0:g} {x1:g} {y1:g} px is not within the picture, "
            f"0 0 {columns - 1} {rows - 1} px"
        )
    return x0, y0, x1, y1
