"""How a motion is divided among planforms: a measure of deformation, and the legs of time that each planform serves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# About what takes a good planform to 70° of non-orthogonality: measured on the pinch at level coarse (docs/mesh.md)
GAP_FACTOR = 3.0  # change of a gap
BEND_SCALE = np.radians(110.0)
HYSTERESIS = 0.1  # of a part: a motion must turn back by as much before an earlier planform is taken again
PADDING = 4  # time steps beyond a leg's end that its shapes cover
RESTING = (
    1e-8  # of a planform's reach in a time step: less is no motion (well below 1e-6 of any stroke's speed)
)
LEAST_REST = 0.1  # of a run's steps: a shorter rest at its end is not worth a leg of its own


def deformation(bend: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """Way (knot,) through bends (rad) and gaps (m; may be infinite), from the first shape on; 1 is a planform's reach."""
    near = np.log(np.minimum(gap, 1.0)) / np.log(GAP_FACTOR)
    return np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(bend) / BEND_SCALE, np.diff(near)))])


@dataclass(frozen=True)
class Part:
    """A part of the way, `low` to `high`, and the legs (first step, last step) that it serves."""

    low: float
    high: float
    legs: tuple[tuple[int, int], ...]

    @property
    def middle(self) -> float:
        """Where its planform is built."""
        return 0.5 * (self.low + self.high)


def divide(way: np.ndarray, count: int, sampling: int, run_in: int) -> list[Part]:
    """Divide a motion into legs on at most `count` planforms, each for an equal part of the way.

    `way` (step + 1,) is that of the motion's shape after each time step. Legs begin at multiples of `sampling` steps and
    are longer than two run-ins; the shapes of a planform cover those of its legs and of the `run_in` steps before each.
    A planform that no leg needs is left out. A long rest at the end is a leg of its own, whose mesh stands still.
    """
    low, width = float(way.min()), float(np.ptp(way)) / count
    steps = len(way) - 1

    def part_of(value: float) -> int:
        return min(max(int((value - low) / width), 0), count - 1) if width > 0 else 0

    legs: list[tuple[int, int]] = []  # part, first step
    for step in range(0, steps, sampling):
        here = part_of(way[step])
        if not legs or here > legs[-1][0] or way[step] < low + width * (legs[-1][0] - HYSTERESIS):
            legs.append((here, step))
    legs = _without_short_ones(legs, steps, 2 * run_in + 1)
    rest = -(-(last_move(way) + run_in + 1) // sampling) * sampling
    if steps - rest >= max(2 * run_in + 1, LEAST_REST * steps) and rest - legs[-1][1] > 2 * run_in:
        legs.append((legs[-1][0], rest))
    ends = [first for _, first in legs[1:]] + [steps]
    parts = []
    for part in sorted({part for part, _ in legs}):
        mine = tuple((first, end) for (number, first), end in zip(legs, ends, strict=True) if number == part)
        reached = np.concatenate([way[max(0, first - run_in) : end + PADDING + 1] for first, end in mine])
        parts.append(Part(float(reached.min()), float(reached.max()), mine))
    return parts


def last_move(way: np.ndarray) -> int:
    """The last time step in which a motion with `way` (step + 1,) moves; 0 where none does."""
    moving = np.flatnonzero(np.abs(np.diff(way)) > RESTING)
    return int(moving[-1]) + 1 if len(moving) else 0


def _without_short_ones(legs: list[tuple[int, int]], steps: int, least: int) -> list[tuple[int, int]]:
    """Legs (part, first step) of at least `least` steps; time of shorter ones goes to the leg before, or else to the next."""
    kept: list[tuple[int, int]] = []
    for (part, first), end in zip(legs, [first for _, first in legs[1:]] + [steps], strict=True):
        if kept and (kept[-1][0] == part or end - first < least):
            continue
        if kept and first - kept[-1][1] < least:  # only the first can be left short
            first = kept.pop()[1]
        kept.append((part, first))
    return kept
