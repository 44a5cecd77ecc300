"""Shake of the camera: what all vectors of a frame have in common beyond a uniform motion."""

from typing import Any

import cv2
import numpy as np
from numpy import ndarray

from piv.correlation.options import OptionWords
from piv.correlation.pair import correlate_pair

_COARSE: OptionWords = {
    "window": 64,
    "least_window": 64,
    "spacing": 48,
    "preset": "fast",
    "smoothing": False,
}
# px RMS; less does not hold the correlation back, and the flow's own acceleration looks like it
_LEAST_SHAKE = 0.1
LEAST_SIDE = 192  # px: smaller frames hold too few coarse windows
LEAST_VECTORS = 12  # in common of all pairs


def frame_shifts(frames: list[Any], masks: list[Any]) -> ndarray | None:
    """Shift (n, 2: x, y down, px) of each frame against the middle one beyond uniform motion.

    Each vector's displacement from frame to frame less its mean over the set is the shake, the same
    all over the frame. None where it cannot be measured: frames below LEAST_SIDE, or fewer than
    LEAST_VECTORS.
    """
    if min(np.shape(frames[0])) < LEAST_SIDE:
        return None
    moves = []
    for k in range(len(frames) - 1):
        field = correlate_pair(frames[k], frames[k + 1], mask=(masks[k], masks[k + 1]), **_COARSE)
        known = field["valid"].values != 0
        moves.append([np.where(known, field["u"], np.nan), np.where(known, -field["v"], np.nan)])
    odd = np.array(moves) - np.mean(moves, axis=0)  # absent where it is in any pair
    if np.count_nonzero(np.isfinite(odd[0, 0])) < LEAST_VECTORS:
        return None
    jumps = np.nanmedian(odd, axis=(2, 3))
    places = np.vstack([np.zeros((1, 2)), np.cumsum(jumps, axis=0)])
    # a straight line through the places of all frames errs less than one through the outer two
    at = np.arange(len(frames)) - len(frames) // 2
    shifts = places - np.outer(at, at @ places / (at @ at))
    shifts -= shifts[len(frames) // 2]
    return shifts if np.sqrt(np.mean(shifts**2)) > _LEAST_SHAKE else np.zeros_like(shifts)


def shifted(
    frames: list[ndarray], masks: list[ndarray | None], shifts: ndarray
) -> tuple[list[ndarray], list[ndarray | None]]:
    """Frames and masks (true = body) moved back by `shifts`: Lanczos interpolation, float32."""
    images: list[ndarray] = []
    bodies: list[ndarray | None] = []
    for image, body, (x, y) in zip(frames, masks, shifts, strict=True):
        back = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
        images.append(_moved(image, back, cv2.INTER_LANCZOS4))
        bodies.append(None if body is None else _moved(body, back, cv2.INTER_LINEAR) > 0)
    return images, bodies


def _moved(image: ndarray, back: ndarray, interpolation: int) -> ndarray:
    size = (image.shape[1], image.shape[0])
    flags = interpolation | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(
        image.astype(np.float32), back, size, flags=flags, borderMode=cv2.BORDER_REFLECT_101
    )
