"""`make faults`: what happens to a run when the machine fails it, tried for real on a small copy of the project.

kill -9 in every stage; disks that are full and folders that cannot be written; paths with a space or other letters;
damaged and foreign files between the stages; OpenFOAM missing or too old; two makes at once.
"""

from __future__ import annotations

import argparse
import csv
import random
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path

from fileio.atomic import whole
from tests.studies.faults import conditions, kill
from tests.studies.faults.project import PRODUCTS, SCENE, copy_project, make

KILL_COLUMNS = ("stage", "kills", "runs_compared", "difference", "date")
CONDITION_COLUMNS = ("condition", "stage", "ended", "sentence", "afterwards", "date")


def write_table(path: Path, columns: tuple[str, ...], rows: list[dict[str, object]]) -> None:
    """A CSV, whole or not at all."""
    with whole(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows({"date": datetime.now(UTC).date().isoformat()} | row for row in rows)


def make_before(project: Path, stage: str) -> None:
    """What a stage needs, undisturbed."""
    order = list(PRODUCTS)
    if stage != order[0]:
        done = make(project, f"{SCENE}.{order[order.index(stage) - 1]}")
        assert done.returncode == 0, done.stderr[-2000:]


def main() -> int:
    """Command line; 1 where something was lost, half-written or not one clear sentence."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.faults", description=__doc__)
    parser.add_argument("--kills", type=int, default=6, help="in each stage (default: %(default)s)")
    parser.add_argument("--stages", help="names with commas (default: all)")
    parser.add_argument("--only", choices=("kills", "conditions"), help="(default: both)")
    parser.add_argument(
        "--seed", type=int, default=0, help="of the times of the kills (default: %(default)s)"
    )
    parser.add_argument(
        "--tables", type=Path, default=Path("docs/stability"), help="folder of the tables"
    )
    parser.add_argument(
        "--folder", type=Path, help="where the copy of the project is kept (default: temporary)"
    )
    args = parser.parse_args()
    stages = args.stages.split(",") if args.stages else list(PRODUCTS)
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.folder or Path(temporary)
        project, wanted = folder / "project", folder / "wanted"
        if not project.exists():
            copy_project(project)
        durations = kill.undisturbed(project, wanted)
        failures = 0
        if args.only != "conditions":
            rows = []
            for stage in stages:
                make_before(project, stage)
                row = kill.kills_in(
                    project, wanted, stage, durations[stage], args.kills, random.Random(f"{args.seed}{stage}"),
                    folder / "log",
                )  # fmt: skip
                rows.append(row)
                print(
                    f"kill -9 in {stage}: {row['kills']} times, {row['difference'] or 'as undisturbed'}",
                    flush=True,
                )
                failures += bool(row["difference"])
            print(f"{sum(int(str(row['kills'])) for row in rows)} kills, {failures} failures")
            write_table(args.tables / "stage_kills.csv", KILL_COLUMNS, rows)
            make_before(project, "report")
        if args.only != "kills":
            condition_rows = []
            for row in conditions.all_conditions(project, wanted, folder, stages):
                condition_rows.append(row)
                print(f"{row['condition']} / {row['stage']}: {row['ended']}; {row['sentence']}; {row['afterwards']}",
                      flush=True)  # fmt: skip
                failures += row["ended"] == "wrong" or row["afterwards"] not in (
                    "",
                    "works",
                    "as undisturbed",
                )
            write_table(args.tables / "faults.csv", CONDITION_COLUMNS, condition_rows)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
