"""What a time step costs: on a moving and on a static mesh, on one rank and on two, with and without samples; in one run.

python -m tests.studies.step_cost --level coarse [-o pipeline/study/steps.csv]   (make bench-steps)
The single finger is solved to the middle of its stroke; from those fields each variant goes on for the same steps. On the
static mesh the wall keeps its velocity, so that the flow is as busy, and each pressure solve takes as many cycles as it did on
the moving one, so that the two differ by the motion alone. Run it on a machine that does nothing else.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd

from fileio.atomic import whole
from fileio.formats.mesh_intervals import read_intervals
from pipeline import case
from pipeline.kinematics import stage as kinematics
from pipeline.mesh import stage as mesh
from pipeline.openfoam.displacement_files import Steps, time_name
from pipeline.openfoam.environment import environment_in, foam_version, solver_command
from pipeline.openfoam.ranks import Ranks
from pipeline.run.prepare import prepare
from pipeline.run.solver import reset_displacement, set_number
from pipeline.scene.scene import Scene, load_scene
from pipeline.study.scaling_data import STEPS, size

ROOT = Path(__file__).resolve().parents[2]
MIDDLE = 0.15  # s: the finger is near its highest speed
LOG = "log.step_cost"


def scene_at(level: str) -> Scene:
    """The single finger in a folder of its own, ready to be solved."""
    folder = ROOT / "cases" / "single_finger" / "out" / "step_cost"
    folder.mkdir(parents=True, exist_ok=True)
    states = 'motion = { states = "../../kinematics/states.h5" }\n'
    (folder / "scene.toml").write_text(f'extends = "../.."\n{states}')
    scene = load_scene(folder, level)
    scene.out.mkdir(parents=True, exist_ok=True)
    for stage in (kinematics, mesh, case):
        stage.run(scene, quiet=True)
    return scene


def run(folder: Path, ranks: Ranks) -> None:
    """Start the solver in a case and wait for it."""
    with (folder / LOG).open("w") as log:
        subprocess.run(
            solver_command(ranks.count),
            cwd=folder,
            env=environment_in(folder),
            stdout=log,
            check=True,
        )


def step_seconds(folder: Path) -> dict[str, float]:
    """Wall time of a step (s), pressure iterations and Courant number, from a log whose first step is left out."""
    text = (folder / LOG).read_text()
    clock = [float(t) for t in re.findall(r"^ExecutionTime = ([\d.]+)", text, re.M)]
    iterations = [int(n) for n in re.findall(r"Solving for p,.*No Iterations (\d+)", text)]
    courant = [float(c) for c in re.findall(r"^Courant Number.*max: ([\d.e-]+)", text, re.M)]
    return {
        "step_s": (clock[-1] - clock[0]) / (len(clock) - 1),
        "pressure_iterations": sum(iterations) / len(clock),
        "courant_max": max(courant),
    }


def cycles_of(folder: Path, correctors: int) -> list[int]:
    """Mean number of cycles of each of a step's pressure solves, rounded, from a log."""
    iterations = re.findall(r"Solving for p,.*No Iterations (\d+)", (folder / LOG).read_text())
    return [round(n) for n in np.reshape(iterations, (-1, correctors)).astype(int).mean(axis=0)]


def fix_cycles(folder: Path, cycles: list[int]) -> None:
    """Have the last pressure solve of a step, and each before it, take just so many cycles."""
    of_solver = {"p": round(float(np.mean(cycles[:-1] or cycles))), "pFinal": cycles[-1]}
    entries = (
        f"{name} {{ tolerance 0; relTol 0; minIter {n}; maxIter {n}; }}"
        for name, n in of_solver.items()
    )
    with (folder / "system" / "fvSolution").open("a") as file:
        file.write(f"\nsolvers {{ {' '.join(entries)} }} // joins the dictionary above\n")


def to_the_middle(scene: Scene, ranks: Ranks) -> Path:
    """The case solved to MIDDLE on some ranks."""
    intervals = read_intervals(scene.out)
    first = intervals[0]
    steps = Steps.of(first.begin, first.end, scene.numerics.time_step)
    prepare(scene.out, intervals, first, ranks, steps, quiet=True)
    folder = scene.out / "case" / intervals[0].name
    set_number(folder, "startTime", time_name(0.0))
    set_number(folder, "endTime", f"{MIDDLE:g}")
    set_number(folder, "writeInterval", f"{MIDDLE:g}")
    run(folder, ranks)
    return folder


def variant(
    solved: Path, ranks: Ranks, steps: int, step: float, samples: bool, cycles: list[int] | None
) -> Path:
    """Some steps from MIDDLE on in a copy of the solved case; `cycles` of the pressure on a static mesh, None: it moves."""
    folder = solved.parent / "variant"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(solved, folder)
    shutil.rmtree(folder / "postProcessing", ignore_errors=True)
    first = time_name(MIDDLE)
    if cycles is None:
        reset_displacement(ranks.folders(folder), time_name(0.0), first, whole=False)
    else:
        set_number(folder, "meshMotion", "staticFvMesh")
        fix_cycles(folder, cycles)
        for place in ranks.folders(folder):
            for name in ("meshPhi", "V0", "V00"):
                (place / first / name).unlink(missing_ok=True)
    if not samples:
        (folder / "system" / "functions").write_text("// nothing is recorded\n")
    set_number(folder, "startTime", first)
    set_number(folder, "endTime", f"{MIDDLE + steps * step:.8g}")
    set_number(folder, "writeInterval", "10")
    run(folder, ranks)
    return folder


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.step_cost", description=__doc__)
    parser.add_argument("--level", default="coarse")
    parser.add_argument("--steps", type=int, default=30)
    parser.add_argument(
        "--rounds", type=int, default=3, help="each variant so often; the fastest counts"
    )
    parser.add_argument("-o", "--output", type=Path, default=STEPS)
    args = parser.parse_args()
    scene = scene_at(args.level)
    cells, columns = size(scene)
    numerics = scene.numerics
    about = {
        "level": args.level,
        "cells": cells,
        "columns": columns,
        "correctors": numerics.pressure_correctors * (1 + numerics.non_orthogonal_correctors),
    }
    rows = []
    for count in (1, 2):
        ranks = Ranks(count)
        solved = to_the_middle(scene, ranks)
        # rounds outside, so that what slows the machine for a while slows all variants alike
        tries: dict[tuple[str, bool], list[dict[str, float]]] = {
            (mesh_kind, samples): []
            for mesh_kind in ("moving", "static")
            for samples in (True, False)
        }
        cycles = None
        for _ in range(args.rounds):
            for mesh_kind, samples in tries:
                fixed = cycles if mesh_kind == "static" else None
                folder = variant(
                    solved, ranks, args.steps, scene.numerics.time_step, samples, fixed
                )
                cycles = fixed or cycles_of(folder, about["correctors"])
                tries[mesh_kind, samples].append(step_seconds(folder))
        for (mesh_kind, samples), timings in tries.items():
            best = min(timings, key=lambda row: row["step_s"])
            rows.append({**about, "ranks": count, "mesh": mesh_kind, "samples": samples, **best})
            print(
                {key: round(v, 4) if isinstance(v, float) else v for key, v in rows[-1].items()},
                flush=True,
            )
    table = pd.DataFrame(rows)
    made = {
        "made": datetime.now(UTC).date().isoformat(),
        "versions": {"OpenFOAM": foam_version()},
        "scene_hash": scene.digest(),
    }
    with whole(args.output) as part, part.open("w", encoding="utf-8") as file:
        file.write(f"# {json.dumps(made)}\n")
        table.to_csv(file, index=False, float_format="%.5g", lineterminator="\n")
    cost = table.set_index(["ranks", "mesh", "samples"])["step_s"]
    print(f"moving / static: {cost[1, 'moving', False] / cost[1, 'static', False]:.2f}")
    print(f"one rank / two ranks: {cost[1, 'moving', True] / cost[2, 'moving', True]:.2f}")
    print(
        f"samples and forces: {cost[1, 'moving', True] / cost[1, 'moving', False] - 1:.1%} of the solver"
    )


if __name__ == "__main__":
    main()
