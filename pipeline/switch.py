"""The switch between two legs: the flow at its end carried to the next mesh, and what was lost on the way."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import StageError
from pipeline.foamfile import END, header, read_field, read_labels, write_bytes, write_field
from pipeline.frames import steps_of, time_name
from pipeline.legs import Leg, read_stage
from pipeline.motion import read_motion
from pipeline.scene import Scene
from pipeline.stage import read_dataset, write_text
from pipeline.swept import SweptCells, carry, swept_cells

SWITCH = "switch.json"  # in a leg's folder: what carrying the flow to it has cost


def cells_of(scene: Scene, leg: Leg, time: float) -> SweptCells:
    """The mesh of a leg in its shape at `time` s."""
    planform = read_stage(scene.out, leg.stage)
    motion = read_motion(scene.out, leg.stage)
    with read_dataset(scene.out / "sweep.h5", "sweep", leg.name) as sweep:
        return swept_cells(planform, sweep.load(), motion.nodes(time), motion.velocity(time))


def read_cells(case: Path, time: str, name: str, ranks: int, cells: int) -> np.ndarray:
    """A field of all cells in the mesh's own order, from one folder or from those of all ranks."""
    if ranks == 1:
        return read_field(case / time / name, cells)
    whole: np.ndarray | None = None
    for folder in sorted(case.glob("processor*")):
        members = read_labels(folder / "constant" / "polyMesh" / "cellProcAddressing")
        part = read_field(folder / time / name, len(members))
        if whole is None:
            whole = np.full((cells, *part.shape[1:]), np.nan)
        whole[members] = part
    if whole is None or np.isnan(whole).any():
        raise StageError(
            f"{case}: {name} at {time} s is not whole; delete the case folder and run make again"
        )
    return whole


def kinetic_energy(cells: SweptCells, velocity: np.ndarray, density: float) -> float:
    """Of the computed part of the tank, J."""
    return float(0.5 * density * np.sum(cells.volume * (velocity**2).sum(1)))


def carry_over(scene: Scene, before: Leg, leg: Leg, ranks: int) -> None:
    """Write the fields with which `leg` begins into its case, from those of the leg before it at that time."""
    old, new = scene.out / "case" / before.name, scene.out / "case" / leg.name
    step = scene.numerics.time_step
    begin = leg.begin(step)
    name = time_name(begin)
    source, target = (cells_of(scene, of, begin) for of in (before, leg))
    velocity, pressure = (read_cells(old, name, field, ranks, len(source.column)) for field in ("U", "p"))
    carried = carry(source, target, velocity, no_slip=True)
    write_field(new / name / "U", new / "0.orig" / "U", carried)
    write_field(
        new / name / "p", new / "0.orig" / "p", carry(source, target, pressure[:, None], no_slip=False)[:, 0]
    )
    for path in (new / "0.orig").iterdir():
        if not (new / name / path.name).exists():
            write_bytes(new / name / path.name, path.read_bytes() + END)
    # the sheet's pictures keep their phase over the switch
    index = b"index %d;\n" % steps_of(begin, step)
    time_header = header("dictionary", f"{name}/uniform", "time", binary=False)
    write_bytes(new / name / "uniform" / "time", time_header + index + END)
    energies = [
        kinetic_energy(cells, u, scene.fluid.density) for cells, u in ((source, velocity), (target, carried))
    ]
    record: dict[str, Any] = {
        "carried_at": begin,
        "kinetic_energy_before": energies[0],
        "kinetic_energy_after": energies[1],
    }
    write_text(new / SWITCH, json.dumps(record))
