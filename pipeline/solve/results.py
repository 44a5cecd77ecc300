"""From the solver's raw output to tables: forces, power balance, history of the run."""

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.integrate import cumulative_trapezoid

from pipeline.formats.mesh_intervals import PER_FINGER
from pipeline.formats.records import (
    FORCES,
    HISTORY,
    MESH_QUALITY,
    POWER,
    POWER_TERMS,
    RUN,
    THROUGH_FLOW,
)
from pipeline.openfoam.displacement_files import steps_of
from pipeline.openfoam.environment import foam_version
from pipeline.openfoam.function_objects import read_function_object
from pipeline.openfoam.through_flow import through_rows
from pipeline.scene.current import Stream
from pipeline.scene.obstacle import OBSTACLE_PATCHES, forces_name
from pipeline.scene.scene import Scene
from pipeline.solve.checkpoint import LOG
from pipeline.solve.guards import energy_from_nothing, power_warning, step_warning
from pipeline.solve.interval import SolverInterval
from pipeline.solve.power import power_balance, power_rows, term_rows
from pipeline.solve.solver import Progress
from piv.files.provenance import versions


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


def _joined(parts: Sequence[SolverInterval], tables: list[ndarray]) -> ndarray:
    """One table (time, …) of those of all intervals, without their overlaps."""
    return np.vstack(
        [
            table[table[:, 0] > part.span.start + 1e-9]
            for part, table in zip(parts, tables, strict=True)
        ]
    )


def write_results(
    scene: Scene, parts: Sequence[SolverInterval], spent: Sequence[Progress], quiet: bool
) -> dict[str, float]:
    """Write the tables of run/ and, last, run.json; returns the cost of interrupted runs.

    `spent`: progress of each interval, before and now.
    """
    summary = _tables(scene, parts)
    balance = summary["power_balance"]
    wall_time = round(sum(float(now["wall_time"]) for _, now in spent), 2)
    resumed = [at for _, now in spent for at in now["resumed"]]
    case, end, step = parts[0].case, scene.motion.end_time, scene.numerics.time_step
    about = {
        "versions": {"OpenFOAM": foam_version()} | versions(),
        "scene": scene.name,
        "level": scene.level,
        "model": scene.model.kind,
        "ranks": case.ranks,
        "time_step": step,
        "end_time": end,
        "steps": steps_of(end, step),
        "wall_time": wall_time,
        "resumed": resumed,
    }
    RUN.write(scene.out / "run" / "run.json", about | summary)
    if not quiet:
        rest = 100 * abs(balance["unexplained_fraction"])
        times = ", ".join(f"{at:g} s" for at in resumed)
        more = f", resumed at {times}" if times else ""
        print(f"solve: {wall_time:.0f} s of solver{more}, {rest:.1f} % of the power unexplained")
        if balance["warning"]:
            print(f"solve: warning: {balance['warning']}")
    return {name: sum(before[name] for before, _ in spent) for name in ("wall_time", "cpu_time")}


def _through_flow(
    scene: Scene, parts: Sequence[SolverInterval], copies: int, obstacles: list[str]
) -> tuple[ndarray, dict[str, Any]]:
    """Write through_flow.csv; what a current brings, and `through_flow` of run.json.

    The first: rows of time (s), power (W) and its integral (J).

    There of the momentum along x what is unexplained, over what the ends give in both directions:
    they give what the water takes up, and the forces on bodies and walls.
    """
    current, folder = scene.current, scene.out / "run"
    assert current is not None
    samples = [part.case.folder / "postProcessing" for part in parts]
    rows = [through_rows(each, scene.fluid.density, current.sign, copies) for each in samples]
    table = _joined(parts, rows)
    THROUGH_FLOW.write(folder / "through_flow.csv", table)
    time, _, _, power, pushed, momentum, walls = table.T
    brought = cumulative_trapezoid(power, time, initial=0.0)
    found = {}
    if scene.pinch is None:  # the table of forces holds one of two fingers
        on_bodies = walls.copy()
        for name in ("forces", *(f"forces_{obstacle}" for obstacle in obstacles)):
            forces = FORCES.read(folder / f"{name}.csv")
            on_bodies += np.interp(time, forces["time"], forces["fx"])
        step = np.diff(time)
        rest = float(step @ (pushed - on_bodies)[1:] - (momentum[-1] - momentum[0]))
        found["momentum_unexplained"] = rest / float(step @ np.abs(pushed)[1:])
    return np.column_stack([time, power, brought]), {"through_flow": found}


def _tables(scene: Scene, parts: Sequence[SolverInterval]) -> dict[str, Any]:
    """Write the tables of run/, all intervals joined; returns their summary.

    StageError where the whole run has energy from nothing.
    """
    folder, fluid, planform = scene.out / "run", scene.fluid, parts[0].mesh.planform
    per_finger = PER_FINGER[scene.model.kind]
    copies = per_finger * (2 if planform.attrs["mirror"] else 1)  # parts in the whole tank
    cases = [part.case.folder for part in parts]
    logs = [history(case / LOG) for case in cases]
    for earlier, later in pairwise(logs):
        later[:, -1] += earlier[-1, -1]  # the clocks add up
    log = _joined(parts, logs)
    HISTORY.write(folder / "history.csv", log)
    walls = [wall for wall in planform["body_name"].values if wall in OBSTACLE_PATCHES]
    for table, name in (("forces", "forces"), *((f"forces_{w}", forces_name(w)) for w in walls)):
        forces = [_forces(case, per_finger, name) for case in cases]
        FORCES.write(folder / f"{table}.csv", _joined(parts, forces))
    quality = _mesh_quality(scene.motion_folder / "mesh_quality.csv")
    stream = Stream.of(scene)
    convection = scene.numerics.convection
    rows = [term_rows(part.case, part.mesh, fluid, convection, stream) for part in parts]
    terms = np.vstack(rows)
    terms[:, 1:] *= copies
    POWER_TERMS.write(folder / "power_terms.csv", terms)
    energy = _joined(parts, [power_rows(case, fluid, copies) for case in cases])
    POWER.write(folder / "power.csv", energy)
    written = POWER.read(folder / "power.csv").to_numpy()
    through, current = None, dict[str, Any]()
    if scene.current is not None:
        through, current = _through_flow(scene, parts, copies, walls)
        written[:, 1] += np.interp(written[:, 0], *through[:, :2].T)
    budgets = [part.guard.energy.budget for part in parts if part.guard.energy]
    running = stream is not None and stream.begins != 0
    excess = {"from_nothing_fraction": energy_from_nothing(written, budgets, copies, running)}
    balance = power_balance(energy, terms, through, running)
    force, step = FORCES.read(folder / "forces.csv")[["fx", "fy"]], scene.numerics.time_step
    warnings = [
        power_warning(balance["unexplained_share"], budgets, step),
        step_warning(force.to_numpy(), step),
    ]
    return {
        "cells": parts[0].mesh.cells,
        "courant_max": float(np.nanmax(log[:, 2])),
        "continuity_max": float(np.nanmax(np.abs(log[:, 3]))),
        "mesh_quality": quality,
        "power_balance": balance | excess | {"warning": "; ".join(filter(None, warnings))},
        **current,
        "intervals": [
            {
                "start": i.start,
                "end": i.end,
                "mesh": i.mesh,
                "moving": i.moving,
                "cells": p.mesh.cells,
            }
            for p in parts
            for i in [p.span]
        ],
    }
