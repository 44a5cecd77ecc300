"""Masks of a recording's frames: one for all, one image per frame, or polygons that move in time."""

from __future__ import annotations

import glob
import hashlib
import json
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fileio.errors import one_line
from piv.images.image_files import ImageFiles
from piv.images.masks import outline_px, polygons_mask, read_mask
from piv.images.open_recording import IMAGE_SUFFIXES, open_recording
from piv.images.recording import Recording

POLYGON_KEYS = {"format", "format_version", "unit", "roi", "bodies"}


@dataclass(frozen=True)
class Masks:
    """`of(i)`: mask of frame i (bool, image order, True = body); `key`: what tells them from others; `roi` (px) where one is given with them."""

    of: Callable[[int], np.ndarray]
    key: Any
    roi: tuple[float, float, float, float] | None = None


def open_masks(source: str | Path | np.ndarray, recording: Recording) -> Masks:
    """Masks of `recording` from what `source` names, or from an array (bool, image order): one for all frames.

    A polygon (.csv, .txt) or an image: one for all frames. A folder, a pattern or a TIFF stack: one image per frame, as
    `piv mask` writes them. .json or .toml: polygons that move (docs/piv_guide.md). ValueError in one sentence where
    their number, their size or their times do not fit.
    """
    if isinstance(source, np.ndarray):
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


def _still(mask: np.ndarray, name: str, recording: Recording) -> Masks:
    if mask.shape != recording.shape:
        raise ValueError(f"{name}: of shape {mask.shape}, the frames are {recording.shape}")
    return Masks(lambda i: mask, hashlib.sha256(np.packbits(mask).tobytes()).hexdigest())


def _images(source: str, recording: Recording) -> Masks:
    images = open_recording(source)
    if not isinstance(images, ImageFiles):
        raise ValueError(f"{source}: masks are images ({' '.join(IMAGE_SUFFIXES)}), one per frame")
    count, frames = len(images), len(recording)
    if count not in (1, frames):
        raise ValueError(
            f"{source}: {count} masks for {frames} frames; 'piv mask' makes one per frame, or give one for all"
        )
    if images.shape != recording.shape:
        (rows, columns), (high, wide) = images.shape, recording.shape
        raise ValueError(
            f"{source}: the masks are {columns}x{rows} px, the frames are {wide}x{high} px; make them of these frames"
        )
    files = [(str(p), k, p.stat().st_size, p.stat().st_mtime_ns) for p, k in images.pages]
    return Masks(lambda i: images.frame(i if count > 1 else 0) > 0, files)


def _polygons(path: Path, recording: Recording) -> Masks:
    try:
        text = path.read_text(encoding="utf-8")
        content = tomllib.loads(text) if path.suffix.lower() == ".toml" else json.loads(text)
        if not isinstance(content, dict):
            raise ValueError("it is no table of keys and values")
        if unknown := sorted(set(content) - POLYGON_KEYS):
            raise ValueError(
                f"unknown key {unknown[0]!r}; known are {', '.join(sorted(POLYGON_KEYS))}"
            )
        unit = content.get("unit", "px")
        if unit not in ("px", "m"):
            raise ValueError(f"unit is {unit!r}; give 'px' or 'm'")
        bodies = [_corners(body, recording) for body in content.get("bodies", [])]
        roi = content.get("roi")
        if roi is not None:
            roi = roi_px(tuple(map(float, roi)), unit, recording)
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
        bodies = [outline_px(body, *scale_of(recording)) for body in bodies]
    return Masks(lambda i: polygons_mask([body[i] for body in bodies], recording.shape), text, roi)


def _corners(body: dict[str, Any], recording: Recording) -> np.ndarray:
    """Corners (frame, point, 2) of one body in every frame, linear between the instants that are given."""
    if unknown := sorted(set(body) - {"frames", "times", "corners"}):
        raise ValueError(f"unknown key {unknown[0]!r} of a body; known are frames, times, corners")
    if "frames" in body and "times" in body:
        raise ValueError("a body has either frames or times")
    corners = np.array(
        body["corners"], float
    )  # ValueError where the polygons differ in their number of corners
    corners = corners[None] if corners.ndim == 2 else corners
    if (
        corners.ndim != 3
        or corners.shape[1] < 3
        or corners.shape[2] != 2
        or not np.isfinite(corners).all()
    ):
        raise ValueError(
            f"corners are of shape {corners.shape}; give at least 3 of (x, y), equally many at each instant"
        )
    given = np.array(body.get("frames", body.get("times", [0])), float)
    if given.shape != corners.shape[:1] or not (np.diff(given) > 0).all():
        raise ValueError(f"{given.size} ascending instants are needed for {len(corners)} polygons")
    if len(corners) == 1:
        return np.repeat(corners, len(recording), axis=0)
    if "times" in body and recording.times is None:
        raise ValueError(
            "its bodies have times, the recording has none; give --frame-rate-hz, or frames"
        )
    at = recording.times if "times" in body else np.arange(len(recording), dtype=float)
    assert at is not None
    if at[0] < given[0] - 1e-9 or at[-1] > given[-1] + 1e-9:
        raise ValueError(
            f"a body is given from {given[0]:g} to {given[-1]:g}, the recording runs from {at[0]:g} to {at[-1]:g}"
        )
    flat = corners.reshape(len(corners), -1)
    return np.stack([np.interp(at, given, c) for c in flat.T], axis=-1).reshape(
        -1, *corners.shape[1:]
    )


def scale_of(recording: Recording) -> tuple[float, tuple[float, float]]:
    """Metres per px and the origin (px) of a recording; ValueError where it has no scale."""
    scale = recording.attrs.get("scale_m_per_px")
    if scale is None:
        raise ValueError(f"{recording.name}: metres need its scale; give --scale-mm-per-px, or px")
    return float(scale), (
        float(recording.attrs.get("origin_x_px", 0)),
        float(recording.attrs.get("origin_y_px", 0)),
    )


def roi_px(
    roi: tuple[float, ...], unit: str, recording: Recording
) -> tuple[float, float, float, float]:
    """Corners x0, y0, x1, y1 (px, y up) of a region in px or m; ValueError where they are not in the picture."""
    if len(roi) != 4 or not np.isfinite(roi).all():
        raise ValueError(f"a region is x0 y0 x1 y1, got {' '.join(map(str, roi))}")
    ends = (
        np.reshape(roi, (2, 2))
        if unit == "px"
        else outline_px(np.reshape(roi, (2, 2)), *scale_of(recording))
    )
    (x0, y0), (x1, y1) = ends.tolist()
    rows, columns = recording.shape
    if not (x0 < x1 and y0 < y1):
        raise ValueError(
            f"the region {x0:g} {y0:g} {x1:g} {y1:g} px is empty; give x0 < x1 and y0 < y1, y up"
        )
    if x0 < -0.5 or y0 < -0.5 or x1 > columns - 0.5 or y1 > rows - 0.5:
        raise ValueError(
            f"the region {x0:g} {y0:g} {x1:g} {y1:g} px is not within the picture, 0 0 {columns - 1} {rows - 1} px"
        )
    return x0, y0, x1, y1
