"""How a motion is divided among planforms: a measure of deformation, and the intervals of time that each planform serves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# About what takes a good planform to 70° of non-orthogonality: measured on the pinch at level coarse (docs/mesh.md)
GAP_FACTOR = 3.0  # change of a gap
BEND_SCALE = np.radians(110.0)
HYSTERESIS = (
    0.1  # of a part: a motion must turn back by as much before an earlier planform is taken again
)
# Both of two consecutive intervals are solved in their overlap, until the later one no longer depends on its start: the larger of
OVERLAP_TIME = 4e-3  # s
OVERLAP_STEPS = 8
PADDING = 4  # time steps beyond an interval's end that its shapes cover
RESTING = 1e-8  # of a mesh's reach in a time step: less is no motion (well below 1e-6 of any stroke's speed)
LEAST_REST = 0.1  # of a run's steps: a shorter rest at its end is not worth an interval of its own


def cumulative_deformation(bend: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """Deformation (knot,) added up from the first shape on, of bends (rad) and gaps (m; may be infinite); 1 is what one mesh can follow."""
    near = np.log(np.minimum(gap, 1.0)) / np.log(GAP_FACTOR)
    return np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(bend) / BEND_SCALE, np.diff(near)))])


@dataclass(frozen=True)
class Part:
    """A range of deformation, `low` to `high`, and the intervals (first step, last step) that it serves."""

    low: float
    high: float
    intervals: tuple[tuple[int, int], ...]

    @property
    def middle(self) -> float:
        """Where its planform is built."""
        return 0.5 * (self.low + self.high)


def divide(deformation: np.ndarray, count: int, sampling: int, overlap: int) -> list[Part]:
    """Split the run into time intervals of equal deformation; each uses one of at most `count` meshes.

    `deformation` (step + 1,) is that of the shape after each time step. Mesh intervals begin at multiples of `sampling` steps and
    are longer than two overlaps; the shapes of a planform cover those of its intervals and of the `overlap` steps before each.
    A planform that no interval needs is left out. A long rest at the end is an interval of its own, whose mesh stands still.
    """
    low, width = float(deformation.min()), float(np.ptp(deformation)) / count
    steps = len(deformation) - 1

    def part_of(value: float) -> int:
        return min(max(int((value - low) / width), 0), count - 1) if width > 0 else 0

    intervals: list[tuple[int, int]] = []  # part, first step
    for step in range(0, steps, sampling):
        here = part_of(deformation[step])
        if (
            not intervals
            or here > intervals[-1][0]
            or deformation[step] < low + width * (intervals[-1][0] - HYSTERESIS)
        ):
            intervals.append((here, step))
    intervals = _without_short_ones(intervals, steps, 2 * overlap + 1)
    rest = -(-(last_move(deformation) + overlap + 1) // sampling) * sampling
    if (
        steps - rest >= max(2 * overlap + 1, LEAST_REST * steps)
        and rest - intervals[-1][1] > 2 * overlap
    ):
        intervals.append((intervals[-1][0], rest))
    ends = [first for _, first in intervals[1:]] + [steps]
    parts = []
    for part in sorted({part for part, _ in intervals}):
        mine = tuple(
            (first, end)
            for (number, first), end in zip(intervals, ends, strict=True)
            if number == part
        )
        reached = np.concatenate(
            [deformation[max(0, first - overlap) : end + PADDING + 1] for first, end in mine]
        )
        parts.append(Part(float(reached.min()), float(reached.max()), mine))
    return parts


def last_move(deformation: np.ndarray) -> int:
    """The last time step in which a motion with `deformation` (step + 1,) moves; 0 where none does."""
    moving = np.flatnonzero(np.abs(np.diff(deformation)) > RESTING)
    return int(moving[-1]) + 1 if len(moving) else 0


def _without_short_ones(
    intervals: list[tuple[int, int]], steps: int, least: int
) -> list[tuple[int, int]]:
    """Mesh intervals (part, first step) of at least `least` steps; time of shorter ones goes to the interval before, or else to the next."""
    kept: list[tuple[int, int]] = []
    for (part, first), end in zip(
        intervals, [first for _, first in intervals[1:]] + [steps], strict=True
    ):
        if kept and (kept[-1][0] == part or end - first < least):
            continue
        if kept and first - kept[-1][1] < least:  # only the first can be left short
            first = kept.pop()[1]
        kept.append((part, first))
    return kept
