"""Frames that give no field: missing, unreadable, without particles, or a repeated picture.

A laser that misses a shot leaves a black frame, a reflection a saturated one, and a full buffer the
picture before it once more. Fields of such frames would be noise, or at rest.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy import ndarray

from piv.formats.plane_series import NO_PICTURE, REPEATED
from piv.images.recording import Recording, UnreadableFrame

_TYPICAL = 15  # frames, evenly chosen, that show what a frame of the recording looks like
# of the typical contrast: camera noise has less, the weaker laser of a pair has more
_LEAST_CONTRAST = 0.2
_SATURATED = 0.5  # of the pixels at the largest grey value; twice the typical share, too
# of the typical difference between neighbours: codecs leave as much of a repeated picture
_REPEATED = 0.1
_AROUND = 3  # differences to either side that a difference is compared with
_SIDE = 128  # px: pictures are compared by about as many of their rows and columns


class Absent(NamedTuple):
    """Why a frame gives no field: a flag of the plane series, and a sentence."""

    flag: int
    why: str


class _Look(NamedTuple):
    """Contrast of a frame without its finest noise, and the share of pixels at its maximum."""

    contrast: float
    top: float


def _look(image: ndarray) -> _Look:
    smooth = cv2.blur(image, (3, 3))
    return _Look(float(smooth.std()), float(np.mean(image == image.max())))


class FrameCheck:
    """Whether single frames show particles as the others of the recording do."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        count = len(recording)
        chosen = np.unique(np.linspace(0, count - 1, min(_TYPICAL, count)).astype(int))
        looks = []
        for i in map(int, chosen):
            try:
                looks.append(_look(recording.frame(i)))
            except UnreadableFrame:
                continue
        self.typical = _Look(*np.median(looks, axis=0)) if looks else _Look(0.0, 1.0)

    def images(self, chosen: Iterable[int]) -> Iterator[ndarray]:
        """Those of the chosen frames that show particles."""
        for image in map(self.image, map(int, chosen)):
            if not isinstance(image, Absent):
                yield image

    def image(self, i: int) -> ndarray | Absent:
        """Frame `i`, or why it shows nothing."""
        try:
            image = self.recording.frame(i)
        except UnreadableFrame as error:
            return Absent(NO_PICTURE, str(error))
        look = _look(image)
        if look.top > max(_SATURATED, 2 * self.typical.top) and image.max() > 0:
            return Absent(
                NO_PICTURE,
                f"{self.recording.frame_name(i)}: {look.top:.0%} of the picture is saturated",
            )
        if look.contrast < _LEAST_CONTRAST * self.typical.contrast:
            return Absent(
                NO_PICTURE,
                f"{self.recording.frame_name(i)}: shows no particles (contrast "
                f"{look.contrast:.2g}, of the recording {self.typical.contrast:.2g})",
            )
        return image


def absent_frames(
    recording: Recording, sets: Sequence[tuple[int, ...]], part: slice, *, couples: bool,
    repeats: bool,
) -> dict[int, Absent]:  # fmt: skip
    """Frames of `sets[part]` that give no field.

    repeats: whether to look for repeated pictures, in `couples` only for the second equal to the
    first. A picture is repeated whose difference from the one before it is far below that of its
    neighbours. The answer for a frame does not depend on `part`.
    """
    first, last, _ = part.indices(len(sets))
    wanted = {i for frames in sets[first:last] for i in frames}
    more = 2 * _AROUND + 1 if repeats else 0
    near = sets[max(0, first - more) : last + more]
    used = sorted({i for frames in near for i in frames})
    check = FrameCheck(recording)
    found: dict[int, Absent] = {}
    compared: list[int] = []
    differences: list[float] = []
    before: tuple[int, ndarray | None] = (-1, None)
    for i in used:
        image = check.image(i)
        sample = None
        if isinstance(image, Absent):
            found[i] = image
        else:
            sample = _sample(image)
        if repeats and i > 0 and (i % 2 or not couples):
            if before[0] != i - 1:
                try:
                    before = i - 1, _sample(recording.frame(i - 1))
                except UnreadableFrame:
                    before = i - 1, None
            compared.append(i)
            differences.append(_difference(sample, before[1]))
        before = i, sample
    small = [_far_below_others(differences, k) for k in range(len(differences))]
    for k, i in enumerate(compared):
        first = last = k
        while first > 0 and small[first - 1]:
            first -= 1
        while last + 1 < len(small) and small[last + 1]:
            last += 1
        # where a film begins or ends, water may be at rest; a repeat there is equal to the last bit
        within = first > 0 and last + 1 < len(small)
        if small[k] and (within or (first == last and differences[k] == 0)):
            why = f"{recording.frame_name(i)}: repeats the picture before it"
            found.setdefault(i, Absent(REPEATED, why))
    return {i: found[i] for i in sorted(found) if i in wanted}


def _far_below_others(differences: list[float], k: int) -> bool:
    """Whether a difference is small beside those around it: their lower middle."""
    others = differences[max(0, k - _AROUND) : k] + differences[k + 1 : k + 1 + _AROUND]
    usual = sorted(d for d in others if np.isfinite(d))
    # the lower middle: a film that begins or ends at rest has as many zeros beside a zero
    return len(usual) > 1 and differences[k] < _REPEATED * usual[(len(usual) - 1) // 2]


def _difference(a: ndarray | None, b: ndarray | None) -> float:
    return np.nan if a is None or b is None else float(np.abs(a - b).mean())


def _sample(image: ndarray) -> ndarray:
    step = max(1, min(image.shape) // _SIDE)
    return image[::step, ::step].astype(np.float32)
