"""A recording seen through masks, and cut to a region of its picture."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from piv.images.mask_series import Masks, open_masks, roi_px
from piv.images.masks import not_whole
from piv.images.open_recording import row_to_y_px
from piv.images.recording import Recording


class PartOfRecording(Recording):
    """Frames of another recording within a region (px, y up, both ends included), with `masks` beside its own.

    `corner_px` is the region's lower left pixel in the whole picture: results keep the coordinates of that.
    """

    def __init__(
        self, whole: Recording, masks: Masks | None, roi: tuple[float, float, float, float] | None
    ) -> None:
        super().__init__(whole.name, len(whole), None)
        self.whole, self.masks = whole, masks
        self.attrs, self.times = whole.attrs, whole.times
        rows, columns = whole.shape
        x0, y0, x1, y1 = roi or (0, 0, columns - 1, rows - 1)
        left, bottom = max(0, math.ceil(x0)), max(0, math.ceil(y0))
        right, top = min(columns - 1, math.floor(x1)), min(rows - 1, math.floor(y1))
        first, last = int(row_to_y_px(top, rows)), int(row_to_y_px(bottom, rows))
        self.cut = (slice(first, last + 1), slice(left, right + 1))
        self.corner_px = (float(left), float(bottom))
        self.key: Any = [
            None if masks is None else masks.key,
            None if roi is None else [left, bottom, right, top],
        ]

    def _read(self, i: int) -> np.ndarray:
        return np.ascontiguousarray(self.whole.frame(i)[self.cut])

    def mask(self, i: int) -> np.ndarray | None:
        """The body in frame `i`: the recording's own and the further masks."""
        own = self.whole.mask(i)
        if self.masks is not None:
            own = self.masks.of(i) if own is None else self.masks.of(i) | own
        return None if own is None else np.ascontiguousarray(own[self.cut])

    def close(self) -> None:
        """Close the whole recording."""
        self.whole.close()


def part_of_recording(
    recording: Recording,
    mask: str | Path | np.ndarray | None = None,
    roi: tuple[float, ...] | None = None,
    *,
    roi_unit: str = "px",
) -> Recording:
    """`recording` with further masks (file, folder or pattern: `open_masks`), within `roi` (x0, y0, x1, y1, y up; px or m)."""
    masks = open_masks(mask, recording) if mask is not None else None
    region = roi_px(roi, roi_unit, recording) if roi is not None else masks.roi if masks else None
    if masks is None and region is None:
        return recording
    part = PartOfRecording(recording, masks, region)
    if masks is not None and (first := part.mask(0)) is not None:
        not_whole(first, mask if isinstance(mask, (str, Path)) else "the mask")
    return part
