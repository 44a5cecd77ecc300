"""From the solver's raw output to tables: forces, power balance, history of the run."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from fileio.formats.mesh_intervals import PER_FINGER, Interval, read_planform
from fileio.formats.records import FORCES, HISTORY, LOSSES, MESH_QUALITY, POWER, POWER_TERMS
from pipeline.openfoam.displacement_files import time_name
from pipeline.openfoam.function_objects import read_function_object
from pipeline.run.checkpoint import LOG
from pipeline.run.energy import finger_power, resolved_dissipation
from pipeline.run.map_fields import field_mappings
from pipeline.run.power_terms import integrals


def _forces(case: Path, per_finger: int) -> np.ndarray:
    """Columns FORCES: force of the water on one whole finger (the left of two), N."""
    raw = read_function_object(case / "postProcessing" / "forces", "force.dat")
    table = raw[:, [0, 1, 2, 3, 4, 5, 7, 8]].copy()
    table[:, 1:] *= per_finger
    if per_finger > 1:
        table[:, 3] = 0.0  # the mirror half's z-force cancels
    return table


def _power(case: Path, density: float, viscosity: float, copies: int) -> np.ndarray:
    """Columns POWER for the whole tank (all fingers), which holds `copies` of the computed part."""
    raw = read_function_object(case / "postProcessing" / "volumes", "volFieldValue.dat")
    times, square, gradient, half_vorticity = raw.T
    surfaces = case / "postProcessing" / "fingerSurface"
    work = [finger_power(surfaces / time_name(time) / "finger.vtk", density) for time in times]
    dissipation = resolved_dissipation(density, viscosity, gradient, half_vorticity)
    return np.column_stack(
        [times, copies * np.array(work), copies * 0.5 * density * square, copies * dissipation]
    )


def power_balance(table: np.ndarray, terms: np.ndarray) -> dict[str, Any]:
    """Work = kinetic energy + energy taken by each of `terms` (POWER_TERMS) + an unexplained rest.

    `closure`: the rest after the resolved dissipation of `table` (POWER).
    """
    time = np.concatenate([[0.0], table[:, 0]])
    rate = np.vstack([np.zeros(2), table[:, [1, 3]]])
    work, dissipated = np.sum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time)[:, None], axis=0)
    kinetic = table[-1, 2]
    closure = work - kinetic - dissipated
    taken = integrals(terms)
    unexplained = work - kinetic - sum(taken[name] for name in LOSSES)
    scale = abs(work) if work else 1.0
    return {
        "work": float(work),
        "kinetic_energy": float(kinetic),
        "dissipated": float(dissipated),
        "closure": float(closure),
        "closure_fraction": float(closure / scale),
        "taken": taken,
        "unexplained": float(unexplained),
        "unexplained_fraction": float(unexplained / scale),
    }


_STEP = re.compile(
    r" (\S+) max: (\S+)\n.*?^Time = (\S+)\n(.*)^ExecutionTime = .*ClockTime = (\d+) s",
    re.MULTILINE | re.DOTALL,
)
_CONTINUITY = re.compile(r"time step continuity errors : sum local = (\S+), global = (\S+),")
_PRESSURE = re.compile(r"Solving for p,.* No Iterations (\d+)")


def history(log: Path) -> np.ndarray:
    """Columns HISTORY from the solver's log; a resumed run replaces the rows that it repeats."""
    rows: dict[float, list[float]] = {}
    earlier = clock = 0.0
    for block in re.split(r"(?m)^Courant Number mean:", log.read_text(errors="replace"))[1:]:
        step = _STEP.match(block)
        if step is None:
            continue  # cut off where the run was killed; the resumed run repeats it
        mean, largest, time, solution, seconds = step.groups()
        if float(seconds) < clock:  # resumed: the solver's clock starts again
            earlier += clock
        clock = float(seconds)
        continuity = _CONTINUITY.findall(solution)[-1]
        iterations = sum(map(int, _PRESSURE.findall(solution)))
        rows[float(time)] = [
            *map(float, (time, mean, largest, *continuity, iterations)),
            earlier + clock,
        ]
    return np.array([rows[time] for time in sorted(rows)])


def _mesh_quality(path: Path) -> dict[str, float]:
    """Worst of each measure of mesh_quality.csv over the stroke."""
    table = MESH_QUALITY.read(path)
    worst = {"max_non_orthogonality_deg": max, "max_skewness": max, "min_area_ratio": min}
    return {name: float(pick(table[name])) for name, pick in worst.items()}


def copies_of(planform: xr.Dataset) -> int:
    """Computed parts in the whole tank."""
    return PER_FINGER[str(planform.attrs["model"])] * (2 if planform.attrs["mirror"] else 1)


def _joined(intervals: tuple[Interval, ...], tables: list[np.ndarray]) -> np.ndarray:
    """One table (time, …) of those of all intervals, without their overlaps."""
    return np.vstack(
        [
            table[table[:, 0] > interval.start + 1e-9]
            for interval, table in zip(intervals, tables, strict=True)
        ]
    )


def collect_results(out: Path, intervals: tuple[Interval, ...], cells: list[int], density: float,
                    viscosity: float, terms: np.ndarray) -> dict[str, Any]:  # fmt: skip
    """Write the tables of run/, all intervals joined; returns their summary for run.json.

    `cells`: of the mesh of each interval; `terms`: rows POWER_TERMS of the computed part.
    """
    cases = [out / "case" / interval.name for interval in intervals]
    planform = read_planform(out, intervals[0].mesh)
    logs = [history(case / LOG) for case in cases]
    for earlier, later in pairwise(logs):
        later[:, -1] += earlier[-1, -1]  # the clocks add up
    log = _joined(intervals, logs)
    force = [_forces(case, PER_FINGER[str(planform.attrs["model"])]) for case in cases]
    parts = [_power(case, density, viscosity, copies_of(planform)) for case in cases]
    energy = _joined(intervals, parts)
    terms = np.column_stack([terms[:, 0], copies_of(planform) * terms[:, 1:]])
    POWER_TERMS.write(out / "run" / "power_terms.csv", terms)
    FORCES.write(out / "run" / "forces.csv", _joined(intervals, force))
    POWER.write(out / "run" / "power.csv", energy)
    HISTORY.write(out / "run" / "history.csv", log)
    return {
        "cells": cells[0],
        "courant_max": float(np.nanmax(log[:, 2])),
        "continuity_max": float(np.nanmax(np.abs(log[:, 3]))),
        "mesh_quality": _mesh_quality(out / "mesh_quality.csv"),
        "power_balance": power_balance(energy, terms),
        "intervals": [
            {"start": i.start, "end": i.end, "mesh": i.mesh, "moving": i.moving, "cells": count}
            for i, count in zip(intervals, cells, strict=True)
        ],
        "field_mappings": field_mappings(
            intervals, cases, force, [part[:, [0, 2]] for part in parts]
        ),
    }
