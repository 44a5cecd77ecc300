"""From the solver's raw output to tables: forces, power balance, history of the run."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from fileio.atomic import write_text
from fileio.errors import StageError
from fileio.formats.mesh_intervals import Interval, read_planform
from pipeline.openfoam.surface_vtk import read_surface
from pipeline.run.energy import resolved_dissipation
from pipeline.run.mapping_error import field_mappings
from pipeline.run.solver import LOG
from pipeline.scene.scene import Scene

PER_FINGER = {"2d": 1, "half": 2, "quarter": 2, "full": 1}  # fingers per computed part of one
FORCE_COLUMNS = ("time", "fx", "fy", "fz", "fx_pressure", "fy_pressure", "fx_viscous", "fy_viscous")
POWER_COLUMNS = ("time", "finger_power", "kinetic_energy", "dissipation")
HISTORY_COLUMNS = (
    "time", "courant_mean", "courant_max", "continuity_local", "continuity_global", "pressure_iterations", "wall_time",
)  # fmt: skip


def read_function_object(folder: Path, name: str) -> np.ndarray:
    """Rows (time, …) of all `<folder>/<start time>/<name>` joined; a later start replaces what it repeats."""
    parts = sorted((p for p in folder.glob(f"*/{name}")), key=lambda p: float(p.parent.name))
    if not parts:
        raise StageError(f"{folder}: the solver wrote no {name}; delete the case folder and run make again")
    joined = np.empty((0, 0))
    for part in parts:
        lines = [
            re.sub(r"[()]", " ", line) for line in part.read_text().splitlines() if line and line[0] != "#"
        ]
        rows = [line.split() for line in lines]
        whole = [row for row in rows if len(row) == len(rows[0])]  # a killed run may leave half a line
        if not whole:
            continue
        table = np.array(whole, float)
        joined = table if not joined.size else np.vstack([joined[joined[:, 0] < table[0, 0] - 1e-12], table])
    return joined


def forces(case: Path, per_finger: int) -> np.ndarray:
    """Columns FORCE_COLUMNS: force of the water on one whole finger (the left of two), N."""
    raw = read_function_object(case / "postProcessing" / "forces", "force.dat")
    table = raw[:, [0, 1, 2, 3, 4, 5, 7, 8]].copy()
    table[:, 1:] *= per_finger
    if per_finger > 1:
        table[:, 3] = 0.0  # the mirror half's z-force cancels
    return table


def finger_power(path: Path, density: float) -> float:
    """Work rate of the computed part of the finger on the water (W) from its sampled surface."""
    surface = read_surface(path)
    cells = surface.compute_cell_sizes(length=False, volume=False).compute_normals(
        cell_normals=True, point_normals=False, auto_orient_normals=False, consistent_normals=False
    )
    stress = np.asarray(cells["p"])[:, None] * np.asarray(cells["Normals"]) - np.asarray(
        cells["wallShearStress"]
    )
    # OpenFOAM's wall normals point out of the water, into the finger; wallShearStress is that of the wall on the water.
    on_water = -density * stress
    return float(np.einsum("fi,fi,f->", on_water, np.asarray(cells["U"]), np.asarray(cells["Area"])))


def power(case: Path, density: float, viscosity: float, copies: int) -> np.ndarray:
    """Columns POWER_COLUMNS for the whole tank (all fingers), which holds `copies` of the computed part."""
    raw = read_function_object(case / "postProcessing" / "volumes", "volFieldValue.dat")
    times, square, gradient, half_vorticity = raw.T
    surfaces = case / "postProcessing" / "fingerSurface"
    named = {float(folder.name): folder / "finger.vtk" for folder in surfaces.iterdir()}
    keys = np.array(sorted(named))
    nearest = [keys[np.argmin(np.abs(keys - t))] for t in times]
    if np.abs(np.array(nearest) - times).max() > 1e-6:
        lost = times[np.argmax(np.abs(np.array(nearest) - times))]
        raise StageError(f"{surfaces}: no surface at {lost:g} s; delete the case folder and run make again")
    work = [finger_power(named[key], density) for key in nearest]
    dissipation = resolved_dissipation(density, viscosity, gradient, half_vorticity)
    return np.column_stack(
        [times, copies * np.array(work), copies * 0.5 * density * square, copies * dissipation]
    )


def power_balance(table: np.ndarray) -> dict[str, float]:
    """Work = change of kinetic energy + resolved dissipation + closure; the closure is what the schemes dissipate."""
    time = np.concatenate([[0.0], table[:, 0]])
    rate = np.vstack([np.zeros(2), table[:, [1, 3]]])
    work, dissipated = np.sum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time)[:, None], axis=0)
    kinetic = table[-1, 2]
    closure = work - kinetic - dissipated
    scale = abs(work) if work else 1.0
    return {
        "work": float(work),
        "kinetic_energy": float(kinetic),
        "dissipated": float(dissipated),
        "closure": float(closure),
        "closure_fraction": float(closure / scale),
    }


def history(log: Path) -> np.ndarray:
    """Columns HISTORY_COLUMNS from the solver's log; a resumed run replaces what it repeats."""
    rows: dict[float, list[float]] = {}
    state = _Step()
    for line in log.read_text(errors="replace").splitlines():
        try:
            state.read(line)
        except (IndexError, ValueError):
            continue  # cut off where the run was killed; the resumed run repeats it
        if line.startswith("ExecutionTime") and np.isfinite(state.time):
            rows[state.time] = state.row()
    return np.array([rows[t] for t in sorted(rows)])


@dataclass
class _Step:
    """What the log has said of the present time step, and the clock over all parts of a resumed run."""

    time: float = np.nan
    courant: tuple[float, float] = (np.nan, np.nan)
    continuity: tuple[float, float] = (np.nan, np.nan)
    iterations: float = 0.0
    earlier: float = 0.0
    clock: float = 0.0

    def read(self, line: str) -> None:
        words = line.split()
        if line.startswith("Courant Number"):
            self.courant = float(words[3]), float(words[5])
        elif line.startswith("Time = "):
            self.time, self.iterations = float(words[2]), 0.0
        elif "Solving for p," in line:
            self.iterations += float(words[-1])
        elif line.startswith("time step continuity"):
            found = re.findall(r"= ([-+0-9.e]+)", line)
            self.continuity = float(found[0]), float(found[1])
        elif line.startswith("ExecutionTime"):
            clock = float(line.split("ClockTime =")[1].split()[0])
            if clock < self.clock:  # resumed: its clock starts again
                self.earlier += self.clock
            self.clock = clock

    def row(self) -> list[float]:
        return [self.time, *self.courant, *self.continuity, self.iterations, self.earlier + self.clock]


def table_text(columns: tuple[str, ...], table: np.ndarray) -> str:
    """A CSV with one header line and twelve digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([[f"{value:.12g}" for value in row] for row in table])
    return text.getvalue()


def mesh_quality(path: Path) -> dict[str, float]:
    """Worst of each measure of mesh_quality.csv over the stroke; StageError where there is no such table."""
    if not path.exists():
        raise StageError(f"{path}: missing; run the mesh stage first, or make")
    with open(path, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    worst = {"max_non_orthogonality_deg": max, "max_skewness": max, "min_area_ratio": min}
    return {name: pick(float(row[name]) for row in rows) for name, pick in worst.items()}


def copies_of(planform: xr.Dataset) -> int:
    """Computed parts in the whole tank."""
    return PER_FINGER[str(planform.attrs["model"])] * (2 if planform.attrs["mirror"] else 1)


def joined(intervals: tuple[Interval, ...], tables: list[np.ndarray]) -> np.ndarray:
    """One table of those of all intervals, whose first column is the time: what an interval's overlap repeats is left out."""
    return np.vstack(
        [
            table[table[:, 0] > interval.start + 1e-9]
            for interval, table in zip(intervals, tables, strict=True)
        ]
    )


def cell_count(case: Path) -> int | None:
    """Cells of a case's mesh, as its header says."""
    owner = (case / "constant" / "polyMesh" / "owner").read_bytes()[:2000]
    found = re.search(rb"nCells: ?(\d+)", owner)
    return int(found.group(1)) if found else None


def collect_results(scene: Scene, intervals: tuple[Interval, ...], out: Path) -> dict[str, Any]:
    """Write forces.csv, power.csv and history.csv of all intervals joined; returns what run.json says of them."""
    cases = [scene.out / "case" / interval.name for interval in intervals]
    copies, fluid = copies_of(read_planform(scene.out, intervals[0].mesh)), scene.fluid
    logs = [history(case / LOG) for case in cases]
    for earlier, later in pairwise(logs):
        later[:, -1] += earlier[-1, -1]  # the clock goes on
    log = joined(intervals, logs)
    force = [forces(case, PER_FINGER[scene.model.kind]) for case in cases]
    parts = [power(case, fluid.density, fluid.kinematic_viscosity, copies) for case in cases]
    energy = joined(intervals, parts)
    write_text(out / "forces.csv", table_text(FORCE_COLUMNS, joined(intervals, force)))
    write_text(out / "power.csv", table_text(POWER_COLUMNS, energy))
    write_text(out / "history.csv", table_text(HISTORY_COLUMNS, log))
    return {
        "cells": cell_count(cases[0]),
        "courant_max": float(np.nanmax(log[:, 2])),
        "continuity_max": float(np.nanmax(np.abs(log[:, 3]))),
        "mesh_quality": mesh_quality(scene.out / "mesh_quality.csv"),
        "power_balance": power_balance(energy),
        "intervals": [
            {
                "start": interval.start,
                "end": interval.end,
                "mesh": interval.mesh,
                "moving": interval.moving,
                "cells": cell_count(case),
            }
            for interval, case in zip(intervals, cases, strict=True)
        ],
        "field_mappings": field_mappings(intervals, cases, force, [part[:, [0, 2]] for part in parts]),
    }
