"""Likelihood of an outline of the dark finger in pictures of bright particles.

Particles of a Poisson process have no centre within the body. The log-likelihood of an outline is
(rate outside − rate inside)·area − n·ln(rate outside/rate inside), with n particles inside it.
Unlike a threshold on grey levels it needs no closing of gaps, and light at the edge does not move
it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numba
import numpy as np

from piv.files.errors import StageError
from piv.images.masks import dark_body

_COST = 4.0  # at most, of a particle within an outline: a reflection on the body must not move it
# blur of a particle's place: wide, so that single particles are no barriers; as it is measured
ROUGH_PX, FINE_PX = 1.5, 0.5
NOISE = 6.0  # standard deviations of the body's grey level: what is above is a particle
CORE_PX, CLEAR_PX = 9, 15  # from the first guess of the edge: surely inside, surely outside
_UNSHADED = 0.8  # of the finger's width, from its lit side on: no shadow


@dataclass(frozen=True)
class WaterLikelihood:
    """`threshold` (grey level), `rate` (1/px²) of particles, and `cost` of one in an outline."""

    threshold: float
    rate: float
    cost: float

    def image(self, frame: np.ndarray, blur_px: float = FINE_PX) -> np.ndarray:
        """Evidence (rows, columns) of a frame; its sum over a region is for a body there."""
        empty_frame = np.full(frame.shape, np.float32(self.rate))
        row, column = particles(frame, self.threshold)
        i, j = column.astype(int), row.astype(int)
        a, b = (column - i).astype(np.float32), (row - j).astype(np.float32)
        spots = np.zeros_like(empty_frame)
        for dj, wj in ((0, 1 - b), (1, b)):
            for di, wi in ((0, 1 - a), (1, a)):
                np.add.at(spots, (j + dj, i + di), wj * wi)
        return empty_frame - np.float32(self.cost) * cv2.GaussianBlur(spots, (0, 0), blur_px)


def particles(frame: np.ndarray, threshold: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns (px, three-point Gaussian fit) of the local maxima above a grey level."""
    grey = frame.astype(np.float32)
    top = (grey >= cv2.dilate(grey, np.ones((3, 3), np.uint8))) & (grey > threshold)
    top[[0, -1]], top[:, [0, -1]] = False, False
    row, column = np.nonzero(top)
    log = np.log(np.maximum(grey, 1.0))
    places = []
    for at, (dj, di) in ((row, (1, 0)), (column, (0, 1))):
        steps = (-1, 0, 1)
        before, here, after = (log[row + s * dj, column + s * di] for s in steps)
        curve = np.minimum(before + after - 2 * here, -1e-6)
        places.append(at + np.clip(0.5 * (before - after) / curve, -0.5, 0.5))
    return places[0], places[1]


def learn(
    frames: list[np.ndarray],
    masks: list[np.ndarray] | None = None,
    light_from: float | None = None,
    width_px: float = 0.0,
) -> WaterLikelihood:
    """The likelihood of frames (row 0 at the top) with the body roughly at `masks`; None: found.

    `light_from` (rad): only what lies within `width_px` of the lit side is surely the body.
    """
    if masks is None:
        try:
            masks = [dark_body(f) for f in frames]
        except ValueError as error:
            raise StageError(
                f"the finger is not seen as a dark region ({str(error).split(';')[0]}): the"
                " pictures are too dim or hold too few particles; record more light and 0.03 to"
                " 0.08 particles per pixel (docs/lab_protocol.md), or brighten them before"
            ) from None
    cores, clears = [shrunk(m, CORE_PX) for m in masks], [shrunk(~m, CLEAR_PX) for m in masks]
    if light_from is not None:
        onward = _UNSHADED * width_px * np.array([-np.cos(light_from), np.sin(light_from)])
        move = np.column_stack([np.eye(2), onward])
        cores = [
            core & (cv2.warpAffine(mask.astype(np.uint8), move, mask.shape[::-1]) == 0)
            for core, mask in zip(cores, masks, strict=True)
        ]
    inside = np.concatenate([f[m] for f, m in zip(frames, cores, strict=True)]).astype(float)
    if inside.size < 200 or sum(m.sum() for m in clears) < 200:
        raise StageError(
            f"the dark body leaves {inside.size} pixels well inside it; the finger must be wider"
            f" than {2 * CORE_PX} px and must not fill the picture"
        )
    level = float(np.median(inside))
    std = max(1.4826 * float(np.median(np.abs(inside - level))), 0.5)
    threshold = level + NOISE * std
    count, area = np.zeros(2), np.zeros(2)
    for frame, core, clear in zip(frames, cores, clears, strict=True):
        row, column = (np.rint(c).astype(int) for c in particles(frame, threshold))
        for k, region in enumerate((core, clear)):
            count[k] += region[row, column].sum()
            area[k] += region.sum()
    within, rate = (count + 0.5) / area
    if not rate > 5 * within:
        raise StageError(
            f"the dark body holds {within:.2g} bright spots per px², the water {rate:.2g}: the two"
            " cannot be told apart; check that the finger is darker than the seeded water, and"
            " state light_from_deg where light comes from one side"
        )
    cost = min(float(np.log(rate / within)), _COST)
    return WaterLikelihood(threshold, rate - within, cost)


def shrunk(mask: np.ndarray, by_px: int) -> np.ndarray:
    """A mask (rows, columns) without what is within `by_px` of its edge."""
    return cv2.erode(mask.astype(np.uint8), np.ones((2 * by_px + 1,) * 2, np.uint8)).astype(bool)


def integral_image(evidence: np.ndarray, mean: float = 0.0) -> np.ndarray:
    """Integral (rows + 1, columns + 1) of an evidence image less `mean`, from its lower left, y up.

    With `mean` near the image's own, single precision holds it.
    """
    out = np.zeros((evidence.shape[0] + 1, evidence.shape[1] + 1))
    np.cumsum(np.cumsum(evidence[::-1].astype(np.float64) - mean, axis=0), axis=1, out=out[1:, 1:])
    return out


@numba.njit(cache=True, inline="always")
def _up_to(integral, x, y):
    """The integral up to a position (px from the corner), exact for constant pixels."""
    i, j = min(int(x), integral.shape[1] - 2), min(int(y), integral.shape[0] - 2)
    a, b = x - i, y - j
    low = (1 - a) * integral[j, i] + a * integral[j, i + 1]
    high = (1 - a) * integral[j + 1, i] + a * integral[j + 1, i + 1]
    return (1 - b) * low + b * high


@numba.njit(cache=True)
def left_of(integral, mean, x0, y0, x1, y1):
    """Evidence to the left of a piece of an outline, negative where it runs down.

    Differences of the integral: the evidence to the left of both sides of a body cancels exactly.
    """
    rows, columns = integral.shape[0] - 1.0, integral.shape[1] - 1.0
    x = min(max(0.5 * (x0 + x1) + 0.5, 0.0), columns)
    low, high = min(max(y0 + 0.5, 0.0), rows), min(max(y1 + 0.5, 0.0), rows)
    return _up_to(integral, x, high) - _up_to(integral, x, low) + mean * x * (high - low)
