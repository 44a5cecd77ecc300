"""What a switch between two legs did to the flow, measured over the time in which both were solved."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fileio.formats.mesh_intervals import Leg
from fileio.json_text import read_json
from pipeline.run.map_fields import SWITCH

SETTLED = 0.02  # of the run's peak force: a new leg whose force is as near to the old one's has settled


def common(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rows of two tables (time, …) at the times that both hold."""
    first, second = (np.round(table[:, 0] * 1e9).astype(np.int64) for table in (before, after))
    _, first, second = np.intersect1d(first, second, return_indices=True)
    return before[first], after[second]


def settling_time(before: np.ndarray, after: np.ndarray, carried_at: float, peak: float) -> float | None:
    """How long (s) after `carried_at` a leg's force (time, component …) is off that of the leg before it.

    Off is more than SETTLED of `peak`. None where it still is when the leg takes over.
    """
    old, new = common(before, after)
    off = np.abs(old[:, 1:] - new[:, 1:]).max(1) > SETTLED * peak
    if not len(off) or off[-1]:
        return None
    settled = np.flatnonzero(off)
    return float(old[settled[-1] + 1, 0] - carried_at) if len(settled) else 0.0


def switches(legs: tuple[Leg, ...], cases: list[Path], force: list[np.ndarray],
             energy: list[np.ndarray]) -> list[dict[str, Any]]:  # fmt: skip
    """What run.json says of each switch: kinetic energy of the tank (J) on both sides, and when the force had settled.

    `force` (time, component …) and `energy` (time, energy) are those of each leg with its run-in.
    """
    peak = max(float(np.abs(table[:, 1:3]).max()) for table in force)
    found = []
    for k in range(1, len(legs)):
        record = read_json(
            cases[k] / SWITCH, f"delete {cases[k] / 'state.json'} and run make again: that leg begins anew"
        )
        before, after = (float(table[-1, 1]) for table in common(energy[k - 1], energy[k]))
        settled = settling_time(force[k - 1][:, :3], force[k][:, :3], record["carried_at"], peak)
        found.append(
            {
                "time": legs[k].start,
                "kinetic_energy_before": before,
                "kinetic_energy_after": after,
                "jump_fraction": (after - before) / before if before else 0.0,
                "force_settled_after": settled,
            }
            | record
        )
    return found
