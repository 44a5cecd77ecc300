"""Runs and images at the extremes, and drawn runs (python -m docs.evidence.stability).

The runs are studies of one axis at a time and of corners, whose rows may fail. Each ends
completed, refused beforehand, or stopped by a guard; any other ending gives exit code 1. So does a
drawn run that is wrong without a warning.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import pandas as pd
from tqdm import tqdm

from docs.evidence.stability import drawn, images, page
from docs.evidence.stability.solver import read_plans, result
from pipeline.openfoam.environment import foam_version
from piv.files.command import guarded
from piv.files.provenance import versions
from postprocess.tables import write_table
from softfinger.study.outcome import outcome_is_there
from softfinger.study.table import origin

PLAN = "cases/{}/out/studies/{}/plan.json"
DRAWN = Path(PLAN.format("single_finger", "drawn"))
PLANS = [Path(PLAN.format(name, "stability")) for name in ("single_finger", "pinch")]
FOLDER = Path("docs/stability")
PRESETS = ("fast", "balanced", "accurate")
FINE = ("completed", "refused", "stopped", "wrong", "all flagged")  # wrong: with a warning
RUN_COLUMNS = (
    "scene", "axis", "value", "level", "ranks", "ended", "stage", "stopped_at_s", "bend_deg",
    "tip_speed", "tip_acceleration", "cells", "steps", "courant_max", "continuity_max",
    "non_orthogonality_deg", "work_J", "kinetic_J", "closure_fraction", "from_nothing_fraction",
    "peak_force_N", "force_of_plate", "cpu_s", "reason",
)  # fmt: skip
DRAWN_COLUMNS = (
    "run", "level", "numerics.time_step", "motion.strokes", "mesh.wall_cell", "ended",
    "error_peak", "error_impulse", "force_change", "unexplained_share", "courant_max", "warned",
    "reason",
)  # fmt: skip
IMAGE_COLUMNS = ("axis", "value", "preset", "ended", "valid", "rms_px", "wrong_unflagged", "reason")


def main() -> None:
    """Command line; exit code 1 where an ending is not allowed, 2 where runs are missing."""
    parser = argparse.ArgumentParser(prog="python -m docs.evidence.stability", description=__doc__)
    parser.add_argument("--part", choices=("runs", "drawn", "images"), help="(default: all)")
    part, faults = parser.parse_args().part, list[dict[str, Any]]()
    code = guarded("stability", lambda: faults.extend(judge(part)))
    sys.exit(code or int(bool(faults)))


def judge(part: str | None) -> list[dict[str, Any]]:
    """Collect the endings, evaluate the pictures, write the tables; return the faults."""
    made = {"versions": {"OpenFOAM": foam_version()} | versions()}
    ended = list[dict[str, Any]]()
    if part in (None, "runs"):
        plan = read_plans(PLANS)
        ended = [result(run) for run in plan]
        for row in ended:
            print(f"{row['run']:40s} {row['ended']:10s} {row['reason'][:120]}")
        table = pd.DataFrame(ended, columns=RUN_COLUMNS, dtype=object)
        write_table(FOLDER / "runs.csv", table, origin(plan) | made)
    if part in (None, "drawn"):
        finer_runs = drawn.finer_runs(plan := read_plans([DRAWN]))
        runs = [run for run in plan if run["run"] in finer_runs and outcome_is_there(run)]
        drawn_rows = [run | drawn.result(run, finer_runs[run["run"]]) for run in runs]
        table = pd.DataFrame(drawn_rows, columns=DRAWN_COLUMNS, dtype=object)
        head = origin(plan) | made
        table = drawn.with_earlier(table, head["stages"], FOLDER / "drawn.csv")
        write_table(FOLDER / "drawn.csv", table, head)
        print("; ".join(f"{k} {v:.2g}" for k, v in drawn.calibrated(table).items()))
        ended += drawn_rows
    if part in (None, "images"):
        pictures = [(case, preset) for case in images.cases() for preset in PRESETS]
        progress = tqdm(pictures, "images", unit="pair", disable=None)
        image_rows = [images.run_case(*picture) for picture in progress]
        table = pd.DataFrame(image_rows, columns=IMAGE_COLUMNS, dtype=object)
        write_table(FOLDER / "images.csv", table, origin([]) | made)
        ended += image_rows
    page.write(FOLDER)
    faults = [row for row in ended if row["ended"] not in FINE]
    for row in faults:
        print(f"{row['axis']} = {row['value']}: {row['ended']}: {row.get('reason', '')}")
    print(f"{len(ended)} runs and pictures, {len(faults)} faults")
    return faults


if __name__ == "__main__":
    main()
