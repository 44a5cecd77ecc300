"""The error of a field mapping between two mesh intervals, measured over their overlap, in which both are solved."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fileio.formats.mesh_intervals import Interval
from fileio.json_text import read_json
from pipeline.run.map_fields import FIELD_MAPPING

SETTLED = 0.02  # of the run's peak force: a new interval whose force is as near to the old one's has settled


def common(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rows of two tables (time, …) at the times that both hold."""
    first, second = (np.round(table[:, 0] * 1e9).astype(np.int64) for table in (before, after))
    _, first, second = np.intersect1d(first, second, return_indices=True)
    return before[first], after[second]


def settling_time(before: np.ndarray, after: np.ndarray, mapped_at: float, peak: float) -> float | None:
    """How long (s) after `mapped_at` an interval's force (time, component …) is off that of the interval before it.

    Off is more than SETTLED of `peak`. None where it still is when the interval takes over.
    """
    old, new = common(before, after)
    off = np.abs(old[:, 1:] - new[:, 1:]).max(1) > SETTLED * peak
    if not len(off) or off[-1]:
        return None
    settled = np.flatnonzero(off)
    return float(old[settled[-1] + 1, 0] - mapped_at) if len(settled) else 0.0


def field_mappings(intervals: tuple[Interval, ...], cases: list[Path], force: list[np.ndarray],
             energy: list[np.ndarray]) -> list[dict[str, Any]]:  # fmt: skip
    """The records of the field mappings in run.json: kinetic energy of the tank (J) on both sides, and when the force had settled.

    `force` (time, component …) and `energy` (time, energy) are those of each interval with its overlap.
    """
    peak = max(float(np.abs(table[:, 1:3]).max()) for table in force)
    found = []
    for k in range(1, len(intervals)):
        record = read_json(
            cases[k] / FIELD_MAPPING,
            f"delete {cases[k] / 'state.json'} and run make again: that interval begins anew",
        )
        before, after = (float(table[-1, 1]) for table in common(energy[k - 1], energy[k]))
        settled = settling_time(force[k - 1][:, :3], force[k][:, :3], record["mapped_at"], peak)
        found.append(
            {
                "time": intervals[k].start,
                "kinetic_energy_before": before,
                "kinetic_energy_after": after,
                "jump_fraction": (after - before) / before if before else 0.0,
                "force_settled_after": settled,
            }
            | record
        )
    return found
