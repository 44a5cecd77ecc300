"""`make stability`: runs and images at the extremes, one axis at a time and the corners; tables, map and page of the docs.

The runs are studies whose rows may fail, made by the Snakefile; here they are judged. Each ends completed (bounded energy),
refused beforehand, or stopped by a guard; any other outcome is a fault, and the exit code is 1.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tqdm import tqdm

from fileio.atomic import whole
from fileio.command import guarded
from fileio.provenance import versions
from pipeline.openfoam.environment import foam_version
from tests.studies.stability import images, page
from tests.studies.stability.solver import read_plans, result

PLANS = tuple(
    Path(f"cases/{scene}/out/studies/stability/plan.json") for scene in ("single_finger", "pinch")
)
PRESETS = ("fast", "balanced", "accurate")
FINE = ("completed", "refused", "stopped", "all flagged")
RUN_COLUMNS = (
    "scene", "axis", "value", "level", "ranks", "ended", "stage", "stopped_at_s", "bend_deg", "tip_speed",
    "tip_acceleration", "cells", "steps", "courant_max", "continuity_max", "non_orthogonality_deg", "work_J", "kinetic_J",
    "closure_fraction", "from_nothing_fraction", "peak_force_N", "force_of_plate", "cpu_s", "reason",
)  # fmt: skip
IMAGE_COLUMNS = ("axis", "value", "preset", "ended", "valid", "rms_px", "wrong_unflagged", "reason")


def write_table(path: Path, columns: tuple[str, ...], rows: Iterable[dict[str, Any]]) -> None:
    """A CSV with the versions that made it, whole or not at all."""
    with whole(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        made = {
            "date": datetime.now(UTC).date().isoformat(),
            "versions": {"OpenFOAM": foam_version()} | versions(),
        }
        file.write("# " + json.dumps(made) + "\n")
        writer = csv.DictWriter(
            file, columns, extrasaction="ignore", restval="", lineterminator="\n"
        )
        writer.writeheader()
        writer.writerows(rows)


def main() -> None:
    """Command line; exit code 1 where a run or a picture ended in another way than it may, 2 where runs are missing."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.stability", description=__doc__)
    parser.add_argument(
        "--axes", help="names with commas: only these, and no tables (default: all)"
    )
    parser.add_argument("--part", choices=("runs", "images"), help="(default: both)")
    parser.add_argument(
        "--docs", type=Path, default=Path("docs"), help="folder of the page and the tables"
    )
    args = parser.parse_args()
    faults: list[dict[str, Any]] = []

    def action() -> None:
        faults.extend(judge(args))

    sys.exit(guarded("stability", action) or (1 if faults else 0))


def judge(args: argparse.Namespace) -> list[dict[str, Any]]:
    """Gather the outcomes, evaluate the pictures, write tables and page; the rows that are faults."""
    ended: list[dict[str, Any]] = []
    if args.part != "images":
        rows = [
            row
            for row in read_plans(PLANS)
            if args.axes is None or row["axis"] in args.axes.split(",")
        ]
        ended = [result(row) for row in rows]
        for row in ended:
            print(f"{row['run']:40s} {row['ended']:10s} {row['reason'][:120]}")
        if args.axes is None:
            write_table(args.docs / "stability" / "runs.csv", RUN_COLUMNS, ended)
    if args.part != "runs" and args.axes is None:
        pictures = [(c, p) for c in images.cases() for p in PRESETS]
        image_rows = [
            images.run_case(c, p) for c, p in tqdm(pictures, "images", unit="pair", disable=None)
        ]
        ended += image_rows
        write_table(args.docs / "stability" / "images.csv", IMAGE_COLUMNS, image_rows)
    if args.axes is None:
        page.write(args.docs)
    faults = [row for row in ended if row["ended"] not in FINE]
    for row in faults:
        print(f"{row['axis']} = {row['value']}: {row['ended']}: {row.get('reason', '')}")
    print(f"{len(ended)} runs and pictures, {len(faults)} faults")
    return faults


if __name__ == "__main__":
    main()
