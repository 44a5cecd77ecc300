"""The paper's studies of θ, W and materials, from the states that the study `bending` computed: tables and figures in
cases/single_finger/kinematics/studies, which the report of every scene that is moved by the same states shows.

Command: python -m pipeline fea-studies (make fea-studies, which has Snakemake run cases/single_finger/studies/bending.csv first)
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from fileio.errors import StageError
from fileio.formats.bending_states import read
from fileio.json_text import read_json
from pipeline.fea.engines import solid
from pipeline.fea.sections import sections
from pipeline.fea.settings import Actuator, Fea, SolidMesh
from pipeline.fea.solid.calculix import release
from pipeline.fea.studies.figures import draw
from pipeline.fea.studies.tables import Bends, write_results, write_table
from pipeline.scene.scene import load_scene

STUDY = "bending"


def bends_of(plan: dict[str, Any]) -> dict[str, Bends]:
    """The states of every run of a study's plan, by its name. StageError where one was not computed."""
    bends = {}
    for run in plan["runs"]:
        path = Path(run["folder"]) / "kinematics" / "states.h5"
        if not path.exists():
            raise StageError(f"{path}: {run['run']} was not analysed; run make fea-studies")
        states = read(path)
        gap = states.wall_gap if states.wall_gap is not None else np.zeros_like(states.radius)
        bends[run["run"]] = Bends(states.pressure, states.radius, gap)
    return bends


def against_calculix(actuator: Actuator, fea: Fea, work: Path) -> dict[str, Bends]:
    """The default finger in 3-D at 10, 20 and 30 kPa, meshed as finely as the unit cell."""
    m = fea.mesh
    same = SolidMesh(**m.model_dump() | {"cavity": 2 * m.cavity, "gap": 2 * m.gap})
    asked = {
        "solid_mesh": same,
        "first_pressure_kpa": 10.0,
        "last_pressure_kpa": 30.0,
        "pressure_step_kpa": 10.0,
    }
    states = solid(work, actuator, fea.model_copy(update=asked))
    return {f"CalculiX {release()}": Bends(states.pressure, states.radius, states.fit_residual)}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command `fea-studies`."""
    parser.add_argument("case", type=Path, nargs="?", default=Path("cases/single_finger"))
    parser.add_argument(
        "-o", "--output", type=Path, help="folder to write (CASE/kinematics/studies)"
    )
    parser.add_argument(
        "--calculix", action="store_true", help="compare in 3-D again (several minutes)"
    )


def run(args: argparse.Namespace) -> None:
    """Gather the study's states, write tables, draw figures."""
    case = args.case
    output = args.output or case / "kinematics" / "studies"
    path = case / "out" / "studies" / STUDY / "plan.json"
    if not path.exists():
        raise StageError(f"{path}: no plan; run make fea-studies, which makes the runs first")
    bends = bends_of(read_json(path, "run make fea-studies, which writes it anew"))
    write_table(output / "studies.csv", bends)
    if args.calculix:
        scene = load_scene(case)
        compared = against_calculix(*sections(scene), case / "out" / "calculix")
        write_table(output / "calculix.csv", compared, last="fit_residual_mm")
    states = read(case / "kinematics" / "states.h5")
    write_results(output / "results.md", bends, states, output / "calculix.csv")
    draw(output, bends, states)
    print(f"tables and figures → {output}")
