"""From the solver's raw output to tables: forces, power balance, history of the run."""

import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from pipeline.formats.mesh_intervals import PER_FINGER, IntervalMesh
from pipeline.formats.records import FORCES, HISTORY, MESH_QUALITY, POWER, POWER_TERMS
from pipeline.openfoam.function_objects import read_function_object
from pipeline.openfoam.ranks import Ranks
from pipeline.scene.obstacle import OBSTACLE_PATCHES, forces_name
from pipeline.scene.sections import Fluid
from pipeline.solve.checkpoint import LOG
from pipeline.solve.guards import Budget, energy_from_nothing
from pipeline.solve.power import power_balance, power_rows, term_rows
from piv.files.record import of_run


def _forces(case: Path, per_finger: int, name: str = "forces") -> ndarray:
    """Columns FORCES: force of the water on one whole finger (the left of two), or obstacle, N."""
    raw = read_function_object(case / "postProcessing" / name, "force.dat")
    table = raw[:, [0, 1, 2, 3, 4, 5, 7, 8]].copy()
    table[:, 1:] *= per_finger
    if per_finger > 1:
        table[:, 3] = 0.0  # the mirror half's z-force cancels
    return table


_STEP = re.compile(
    r" (\S+) max: (\S+)\n.*?^Time = (\S+)\n(.*)^ExecutionTime = .*ClockTime = (\d+) s",
    re.MULTILINE | re.DOTALL,
)
_CONTINUITY = re.compile(r"time step continuity errors : sum local = (\S+), global = (\S+),")
_PRESSURE = re.compile(r"Solving for p,.* No Iterations (\d+)")


def history(log: Path) -> ndarray:
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


def _joined(meshes: list[IntervalMesh], tables: list[ndarray]) -> ndarray:
    """One table (time, …) of those of all intervals, without their overlaps."""
    return np.vstack(
        [
            table[table[:, 0] > mesh.interval.start + 1e-9]
            for mesh, table in zip(meshes, tables, strict=True)
        ]
    )


def collect_results(
    folder: Path,
    cases: list[Path],
    meshes: list[IntervalMesh],
    ranks: Ranks,
    fluid: Fluid,
    convection: str,
    budgets: list[Budget],
    contact: float | None = None,
) -> dict[str, Any]:
    """Write the tables of run/ in `folder`, all intervals joined; returns their summary.

    The summary's power balance ends before the first `contact` (s), since an impact is shorter than
    what the tables resolve. StageError where `budgets`, of the intervals, find energy from nothing
    in the whole run.
    """
    model, mirror = (meshes[0].planform.attrs[name] for name in ("model", "mirror"))
    per_finger = PER_FINGER[str(model)]
    copies = per_finger * (2 if mirror else 1)  # computed parts in the whole tank
    logs = [history(case / LOG) for case in cases]
    for earlier, later in pairwise(logs):
        later[:, -1] += earlier[-1, -1]  # the clocks add up
    log = _joined(meshes, logs)
    force = [_forces(case, per_finger) for case in cases]
    HISTORY.write(folder / "run" / "history.csv", log)
    FORCES.write(folder / "run" / "forces.csv", _joined(meshes, force))
    for wall in meshes[0].planform["body_name"].values:
        if wall in OBSTACLE_PATCHES:
            tables = [_forces(case, per_finger, forces_name(wall)) for case in cases]
            FORCES.write(folder / "run" / f"forces_{wall}.csv", _joined(meshes, tables))
    quality = _mesh_quality(of_run(folder / "mesh_quality.csv"))
    parts = [power_rows(case, fluid, copies) for case in cases]
    terms = np.vstack(
        [
            term_rows(case, mesh, ranks, fluid, convection)
            for case, mesh in zip(cases, meshes, strict=True)
        ]
    )
    terms[:, 1:] *= copies
    POWER_TERMS.write(folder / "run" / "power_terms.csv", terms)
    energy = _joined(meshes, parts)
    POWER.write(folder / "run" / "power.csv", energy)
    written = POWER.read(folder / "run" / "power.csv").to_numpy()
    excess = {"from_nothing_fraction": energy_from_nothing(written, budgets, copies)}
    until, known = None, [energy, terms]
    if contact is not None:
        until = float(terms[:, 0][terms[:, 0] < contact].max(initial=terms[0, 0]))
        known = [table[table[:, 0] <= until] for table in known]
    return {
        "cells": meshes[0].cells,
        "courant_max": float(np.nanmax(log[:, 2])),
        "continuity_max": float(np.nanmax(np.abs(log[:, 3]))),
        "mesh_quality": quality,
        "power_balance": power_balance(*known) | excess | {"until": until},
        "intervals": [
            {"start": i.start, "end": i.end, "mesh": i.mesh, "moving": i.moving, "cells": m.cells}
            for m in meshes
            for i in [m.interval]
        ],
    }
