"""A film of the finger against a plain background: silhouettes as signed distances, and times."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from piv.files.errors import StageError
from piv.images.clock import frame_times
from piv.images.open_recording import PAIRINGS, Recording, open_recording
from piv.images.recordings.video import Video
from postprocess.lab.pose import Pose

MOST_FRAMES = 60  # that are used of a film, evenly
_BLUR_PX = 1.0
_LEAST_CONTRAST = 20.0  # grey levels between the finger and what is around it
_LEAST_AREA = 0.3  # of the finger's own area, of the silhouette


@dataclass(frozen=True)
class Film:
    """Silhouettes of a film.

    `distance` (frame, row, column): px from the silhouette's edge, positive outside, row 0 below;
    `times` (frame,) s from the first picture; `images` (frame, row, column) in 256 grey levels, row
    0 above. `unused`: pictures after the end of the pressure.
    """

    name: str
    times: np.ndarray
    distance: np.ndarray
    images: np.ndarray
    unused: int = 0

    def at(self, points: np.ndarray) -> np.ndarray:
        """Distances (frame, point) px at points (frame, point, 2) px, y up; linear."""
        out = np.empty(points.shape[:2])
        for k, (picture, places) in enumerate(zip(self.distance, points, strict=True)):
            x, y = (np.ascontiguousarray(places[None, :, k], np.float32) for k in (0, 1))
            out[k] = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0]
        return out


def film_times(recording: Recording, rate: float | None) -> np.ndarray:
    """Times (s) of a film's pictures from the first: by `rate`, the file or its container.

    ValueError where none of them gives times.
    """
    count, name = len(recording), recording.name
    if rate is not None:
        return np.asarray(frame_times(np.arange(count), PAIRINGS[0], None, rate))
    if recording.times is not None:
        return np.asarray(recording.times - recording.times[0])
    if not isinstance(recording, Video):
        raise ValueError(f"{name}: pictures have no times; give --rate, in pictures a second")
    capture, stamps = cv2.VideoCapture(str(recording.path)), []
    while capture.grab():
        stamps.append(1e-3 * capture.get(cv2.CAP_PROP_POS_MSEC))
    capture.release()
    times = np.array(stamps[:count])
    if len(times) < count or np.any(np.diff(times) <= 0):
        raise ValueError(f"{name}: its container states no times; give --rate")
    return times - times[0]


def shape_of(path: Path) -> tuple[int, int]:
    """Rows and columns of a film's pictures. StageError."""
    try:
        with open_recording(path, colour="luma") as recording:
            return recording.shape
    except (ValueError, FileNotFoundError) as error:
        raise StageError(str(error)) from error


def read_film(path: Path, rate: float | None, pose: Pose, outline: np.ndarray, end: float) -> Film:
    """The silhouettes of a film until `end` (s).

    `outline` (point, 2) m: of the finger at rest, which `pose` places in the pictures roughly. It
    tells which of dark and bright is the finger. StageError where no finger is there.
    """
    try:
        with open_recording(path, colour="luma") as recording:
            times = film_times(recording, rate)
            used = int(np.sum(times <= end))
            chosen = np.unique(np.linspace(0, used - 1, MOST_FRAMES).round().astype(int))
            images = _in_grey_levels(np.stack([recording.frame(int(i)) for i in chosen]))
    except (ValueError, FileNotFoundError) as error:
        raise StageError(str(error)) from error
    rows = images.shape[1]
    placed = pose.to_px(outline)
    inside = np.zeros(images.shape[1:], np.uint8)
    corners = np.column_stack([placed[:, 0], rows - 1 - placed[:, 1]])
    cv2.fillPoly(inside, [np.rint(corners).astype(np.int32)], 1)
    if not inside.any():
        raise StageError(f"{path}: the finger at --root and --scale is not in the picture")
    pictures = [
        _silhouette(path, image, inside.astype(bool), int(i))
        for i, image in zip(chosen, images, strict=True)
    ]
    distance = np.stack(pictures)[:, ::-1].copy()
    return Film(path.name, times[chosen], distance, images, len(times) - used)


def _in_grey_levels(images: np.ndarray) -> np.ndarray:
    """Pictures of 8 bits as they are, others with their own darkest and brightest as 0 and 255."""
    if images.dtype == np.uint8:
        return images
    low, high = float(images.min()), float(images.max())
    return np.rint((images - low) * (255 / max(high - low, 1e-9))).astype(np.uint8)


def _silhouette(path: Path, image: np.ndarray, rest: np.ndarray, number: int) -> np.ndarray:
    """Signed distance (row, column) px of the region that the finger at `rest` meets most."""
    grey = cv2.GaussianBlur(image, (0, 0), _BLUR_PX)
    level, _ = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    dark, bright = grey[grey <= level], grey[grey > level]
    contrast = float(np.median(bright) - np.median(dark)) if dark.size and bright.size else 0.0
    # the root stays where it is at rest, whatever the tip does
    root = rest & (np.cumsum(rest.any(axis=1)) < 0.25 * rest.any(axis=1).sum())[:, None]
    is_dark = np.median(grey[root if root.any() else rest]) <= level
    mask = ((grey <= level) == is_dark).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    met = np.bincount(labels[rest & (mask > 0)], minlength=len(stats))
    met[0] = 0
    body = int(np.argmax(met))
    if contrast < _LEAST_CONTRAST or body == 0 or stats[body, -1] < _LEAST_AREA * rest.sum():
        raise StageError(
            f"{path}, picture {number}: no finger is told from its background (contrast"
            f" {contrast:.0f} grey levels); film it dark on bright or bright on dark, with the root"
            " at --root"
        )
    seen = (labels == body).astype(np.uint8)
    out, within = (
        cv2.distanceTransform(part, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for part in (1 - seen, seen)
    )
    return np.where(seen > 0, 0.5 - within, out - 0.5).astype(np.float32)
