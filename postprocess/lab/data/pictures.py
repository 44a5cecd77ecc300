"""A laboratory's pictures: upright, rectified, with times, scale and the finger masked."""

from __future__ import annotations

import cv2
import numpy as np

from fileio.errors import StageError
from piv.images.calibration import Calibration, load_calibration, rectify_image
from piv.images.open_recording import open_recording
from piv.images.recording import Recording
from postprocess.lab.data.dpiv_toml import NAME, Dpiv
from postprocess.lab.data.pose import Pose

GROW_PX = 2  # of the mask beyond the outline: particle images reach over the body's edge


def _frame_times(dpiv: Dpiv, count: int) -> np.ndarray:
    """Times (s) of `count` pictures after the first one."""
    if dpiv.piv.interval_s is None:
        return np.arange(count) / dpiv.frame_rate_hz
    return np.arange(count) // 2 / dpiv.frame_rate_hz + np.arange(count) % 2 * dpiv.piv.interval_s


def _check_rate(dpiv: Dpiv, source: Recording) -> None:
    """StageError where the recording states its own frame rate and dpiv.toml another one."""
    stated = source.attrs.get("frame_rate_hz")
    if stated and dpiv.piv.pairing == "1-2,2-3" and abs(stated * dpiv.interval - 1) > 0.01:
        raise StageError(
            f"{dpiv.folder / NAME}: frame_rate_hz is {dpiv.frame_rate_hz:g}, but {source.name}"
            f" states {stated:g}; correct the one that is wrong"
        )


def thinned(frames: np.ndarray, most: int) -> np.ndarray:
    """At most so many of some frames, evenly spread from the first to the last."""
    at = np.linspace(0, frames.size - 1, min(most, frames.size))
    return frames[np.unique(at.round().astype(int))]


class LabRecording(Recording):
    """The pictures of a dpiv.toml, mirrored and rectified as it states."""

    times: np.ndarray

    def __init__(self, dpiv: Dpiv) -> None:
        try:
            self._source = open_recording(dpiv.sources(), colour=dpiv.colour)
        except ValueError as error:  # PIV knows no StageError
            raise StageError(str(error)) from error
        _check_rate(dpiv, self._source)
        super().__init__(self._source.name, len(self._source))
        self.times = _frame_times(dpiv, len(self._source))
        self._mirror = dpiv.axes.x == "left"
        name = dpiv.scale.calibration
        self.calibration: Calibration | None = None
        if name:
            self.calibration = load_calibration(dpiv.folder / name)

    def _read(self, i: int) -> np.ndarray:
        image = self._source.frame(i)
        if self.calibration is not None and self.calibration.lens is not None:
            image = rectify_image(image, self.calibration)
        return np.ascontiguousarray(image[:, ::-1]) if self._mirror else image

    def close(self) -> None:
        """Close the files."""
        self._source.close()


def stated_pose(dpiv: Dpiv, recording: LabRecording, root: tuple[float, float]) -> Pose:
    """The stated pose of pictures."""
    assert dpiv.axes.root_px is not None
    scale = (recording.calibration or dpiv.scale).scale_mm_per_px
    assert scale is not None
    rows, columns = recording.shape
    x, y = dpiv.axes.root_px
    x = columns - 1 - x if dpiv.axes.x == "left" else x
    y = rows - 1 - y if dpiv.axes.y == "down" else y
    return Pose(scale, float(np.radians(dpiv.axes.turn_deg)), root, (x, y))


class MaskedRecording(Recording):
    """Some frames of a recording, on the simulation's clock, masked by outlines (…, point, 2)."""

    def __init__(
        self,
        source: Recording,
        indices: np.ndarray,
        times: np.ndarray,
        outlines: list[np.ndarray],
        pose: Pose,
    ) -> None:
        super().__init__(source.name, len(indices))
        self._source, self._indices, self._outlines = source, indices, outlines
        self.times = np.asarray(times, float)
        self.attrs = {
            "scale_mm_per_px": pose.scale_mm_per_px,
            "origin_x_px": 0.0,
            "origin_y_px": 0.0,
        }

    def _read(self, i: int) -> np.ndarray:
        return self._source.frame(int(self._indices[i]))

    def mask(self, i: int) -> np.ndarray:
        """The finger of frame `i`, a little grown."""
        return outline_mask(self._outlines[i], self.shape)


def outline_mask(outlines_px: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """True inside outlines (…, point, 2; px, y up) grown by `GROW_PX`, row 0 at the top."""
    mask = np.zeros(shape, np.uint8)
    for outline in outlines_px.reshape(-1, *outlines_px.shape[-2:]):
        corners = np.column_stack([outline[:, 0], shape[0] - 1 - outline[:, 1]])
        cv2.fillPoly(mask, [np.round(corners * 16).astype(np.int32)], 1, shift=4)
    size = 2 * GROW_PX + 1
    return cv2.dilate(mask, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))).astype(bool)
