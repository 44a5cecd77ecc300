"""Field mapping between two mesh intervals: the earlier one's flow on the later one's mesh."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from fileio.atomic import write_text
from fileio.errors import StageError
from fileio.formats.mesh_intervals import Interval, read_planform
from fileio.formats.node_motion import read_motion
from fileio.formats.sweep import read_sweep
from fileio.json_text import read_json
from pipeline.geometry.swept_cells import SweptCells, carry, overlap_of, swept_cells
from pipeline.openfoam.displacement_files import time_name
from pipeline.openfoam.foamfile import (
    END,
    field_of,
    header,
    labels_of,
    read_field,
    write_bytes,
    write_field,
)
from pipeline.openfoam.ranks import Ranks

# of the run's peak force: the forces of two intervals that differ by less agree
_AGREED = 0.02
FIELD_MAPPING = "field_mapping.json"  # in an interval's folder: the change of energy by the mapping


def cells_of(out: Path, interval: Interval, time: float) -> SweptCells:
    """The mesh of an interval in its shape at `time` s."""
    planform = read_planform(out, interval.mesh)
    motion = read_motion(out, interval.mesh)
    return swept_cells(
        planform, read_sweep(out, interval.name), motion.nodes(time), motion.velocity(time)
    )


def read_cells(case: Path, time: str, name: str, ranks: Ranks, cells: int) -> np.ndarray:
    """A field of all cells in the mesh's own order, from one folder or from those of all ranks."""
    if ranks.count == 1:
        return read_field(case / time / name, cells)
    whole: np.ndarray | None = None
    addressing = ranks.contents(case, "constant/polyMesh/cellProcAddressing")
    for labels, content in zip(addressing, ranks.contents(case, f"{time}/{name}"), strict=True):
        members = labels_of(labels)
        part = field_of(content, len(members), case / time / name)
        if whole is None:
            whole = np.full((cells, *part.shape[1:]), np.nan)
        whole[members] = part
    if whole is None or np.isnan(whole).any():
        raise StageError(
            f"{case}: {name} at {time} s is not whole; delete the case folder and run make again"
        )
    return whole


def square_sum(cells: SweptCells, a: np.ndarray, b: np.ndarray) -> float:
    """Integral of the product of two velocity fields (cell, 3) over the cells, m⁵/s²."""
    return float(np.sum(cells.volume * (a * b).sum(1)))


def energy_share(source: SweptCells, target: SweptCells, velocity: np.ndarray, averaged: np.ndarray,
                 sampled: np.ndarray) -> float:  # fmt: skip
    """The share s of `sampled` at which averaged + s (sampled - averaged) has the source's energy.

    Both are of second order. The share is limited to -1…2, so that a flow which neither describes
    is not forced to have the energy.
    """
    change = sampled - averaged
    a, b = square_sum(target, change, change), 2 * square_sum(target, averaged, change)
    c = square_sum(target, averaged, averaged) - square_sum(source, velocity, velocity)
    if a == 0:
        return 0.0
    return float(np.clip((-b + np.sqrt(max(b * b - 4 * a * c, 0.0))) / (2 * a), -1.0, 2.0))


def map_fields(out: Path, before: Interval, interval: Interval, ranks: Ranks, step: int) -> None:
    """Write the first fields of `interval`, at time step number `step`, from the one before it."""
    old, new = out / "case" / before.name, out / "case" / interval.name
    name = time_name(interval.begin)
    source, target = (cells_of(out, of, interval.begin) for of in (before, interval))
    velocity, pressure = (
        read_cells(old, name, field, ranks, len(source.column)) for field in ("U", "p")
    )
    overlap = overlap_of(source, target)
    averaged, sampled = carry(source, target, overlap, velocity, no_slip=True)
    mapped = averaged + energy_share(source, target, velocity, averaged, sampled) * (
        sampled - averaged
    )
    write_field(new / name / "U", new / "0.orig" / "U", mapped)
    first_guess = carry(source, target, overlap, pressure[:, None], no_slip=False)[0][:, 0]
    write_field(new / name / "p", new / "0.orig" / "p", first_guess)
    for path in (new / "0.orig").iterdir():
        if not (new / name / path.name).exists():
            write_bytes(new / name / path.name, path.read_bytes() + END)
    # the sheet's pictures keep their phase over the field mapping
    index = b"index %d;\n" % step
    time_header = header("dictionary", f"{name}/uniform", "time", binary=False)
    write_bytes(new / name / "uniform" / "time", time_header + index + END)
    energy = square_sum(source, velocity, velocity)
    jump = square_sum(target, mapped, mapped) / energy - 1 if energy else 0.0
    write_text(
        new / FIELD_MAPPING,
        json.dumps({"mapped_at": interval.begin, "mapping_jump_fraction": jump}),
    )


def _common(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rows of two tables (time, …) at their common times."""
    first, second = (np.round(table[:, 0] * 1e9).astype(np.int64) for table in (before, after))
    _, first, second = np.intersect1d(first, second, return_indices=True)
    return before[first], after[second]


def settling_time(
    before: np.ndarray, after: np.ndarray, mapped_at: float, peak: float
) -> float | None:
    """Time (s) after `mapped_at` until forces (time, component …) of two intervals agree.

    To agree is to differ by less than _AGREED of `peak`. None where they do not within the overlap.
    """
    old, new = _common(before, after)
    off = np.abs(old[:, 1:] - new[:, 1:]).max(1) > _AGREED * peak
    if not len(off) or off[-1]:
        return None
    return float(old[np.flatnonzero(off)[-1] + 1, 0] - mapped_at) if off.any() else 0.0


def field_mappings(intervals: tuple[Interval, ...], cases: list[Path], force: list[np.ndarray],
             energy: list[np.ndarray]) -> list[dict[str, Any]]:  # fmt: skip
    """The field mappings of run.json: kinetic energy (J) on both sides, settling time of the force.

    `force` (time, component …) and `energy` (time, energy): of each interval with its overlap.
    """
    peak = max(float(np.abs(table[:, 1:3]).max()) for table in force)
    records = []
    for k in range(1, len(intervals)):
        record = read_json(
            cases[k] / FIELD_MAPPING,
            f"delete {cases[k] / 'state.json'} and run make again: that interval is solved anew",
        )
        before, after = (float(table[-1, 1]) for table in _common(energy[k - 1], energy[k]))
        settled = settling_time(force[k - 1][:, :3], force[k][:, :3], record["mapped_at"], peak)
        records.append(
            {
                "time": intervals[k].start,
                "kinetic_energy_before": before,
                "kinetic_energy_after": after,
                "jump_fraction": (after - before) / before if before else 0.0,
                "force_settled_after": settled,
            }
            | record
        )
    return records
