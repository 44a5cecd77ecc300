"""How a motion is divided among planforms: a measure of deformation, and intervals of time."""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

# About what takes a good planform to 70° of non-orthogonality: the pinch at coarse (docs/mesh.md)
_GAP_FACTOR = 3.0  # change of a gap
_BEND_SCALE = np.radians(110.0)
# of a part: a motion must turn back by as much before an earlier planform is taken again
HYSTERESIS = 0.1
# Two consecutive intervals are both solved in their overlap, until the later one no longer depends
# on its start: the larger of
OVERLAP_TIME = 4e-3  # s
OVERLAP_STEPS = 8
PADDING = 4  # time steps beyond an interval's end that its shapes cover
_RESTING = 1e-8  # of a mesh's reach in a time step: less is no motion
_LEAST_REST = 0.1  # of a run's steps: a shorter rest at its end gets no interval of its own


def cumulative_deformation(bend: ndarray, gap: ndarray) -> ndarray:
    """Deformation (knot,) since the first shape, of bends (rad) and gaps (m; may be infinite).

    One mesh can follow about 1.
    """
    near = np.log(np.minimum(gap, 1.0)) / np.log(_GAP_FACTOR)
    return np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(bend) / _BEND_SCALE, np.diff(near)))])


@dataclass(frozen=True)
class Part:
    """A range of deformation, and the intervals (first step, last step) that it serves."""

    low: float
    high: float
    intervals: tuple[tuple[int, int], ...]

    @property
    def middle(self) -> float:
        """Deformation at which the planform is built."""
        return 0.5 * (self.low + self.high)


def divide(deformation: ndarray, count: int, sampling: int, overlap: int) -> list[Part]:
    """Time intervals of equal deformation; each uses one of at most `count` meshes.

    `deformation` (step + 1,) is that after each time step. Intervals begin at multiples of
    `sampling` steps and are longer than two overlaps; the shapes of a planform cover those of its
    intervals and of the `overlap` steps before each. A planform that no interval needs is left out.
    A long rest at the end is an interval of its own, whose mesh stands still.
    """
    low, width = float(deformation.min()), float(np.ptp(deformation)) / count
    steps = len(deformation) - 1
    intervals: list[tuple[int, int]] = []  # part, first step
    for step in range(0, steps, sampling):
        value = deformation[step]
        part = min(max(int((value - low) / width), 0), count - 1) if width > 0 else 0
        if (
            not intervals
            or part > intervals[-1][0]
            or value < low + width * (intervals[-1][0] - HYSTERESIS)
        ):
            intervals.append((part, step))
    intervals = _without_short_ones(intervals, steps, 2 * overlap + 1)
    rest = -(-(last_move(deformation) + overlap + 1) // sampling) * sampling
    long = steps - rest >= max(2 * overlap + 1, _LEAST_REST * steps) and np.ptp(deformation) > 0
    if long and rest - intervals[-1][1] > 2 * overlap:
        intervals.append((intervals[-1][0], rest))
    served: dict[int, list[tuple[int, int]]] = {}
    for part, first, end in _with_ends(intervals, steps):
        served.setdefault(part, []).append((first, end))
    parts = []
    for _, spans in sorted(served.items()):
        reached = np.concatenate(
            [deformation[max(0, first - overlap) : end + PADDING + 1] for first, end in spans]
        )
        parts.append(Part(float(reached.min()), float(reached.max()), tuple(spans)))
    return parts


def _with_ends(intervals: list[tuple[int, int]], steps: int) -> list[tuple[int, int, int]]:
    """Part, first step and last step."""
    ends = [first for _, first in intervals[1:]] + [steps]
    return [(*interval, end) for interval, end in zip(intervals, ends, strict=True)]


def last_move(deformation: ndarray) -> int:
    """The last time step in which a motion with `deformation` (step + 1,) moves; 0 if none."""
    moving = np.flatnonzero(np.abs(np.diff(deformation)) > _RESTING)
    return int(moving[-1]) + 1 if len(moving) else 0


def _without_short_ones(
    intervals: list[tuple[int, int]], steps: int, least: int
) -> list[tuple[int, int]]:
    """Intervals of at least `least` steps; a shorter one goes to the one before, else the next."""
    kept: list[tuple[int, int]] = []
    for part, first, end in _with_ends(intervals, steps):
        if kept and (kept[-1][0] == part or end - first < least):
            continue
        if kept and first - kept[-1][1] < least:  # only the first can be left short
            first = kept.pop()[1]
        kept.append((part, first))
    return kept
