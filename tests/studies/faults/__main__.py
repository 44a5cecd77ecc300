"""`make faults`: faults of the machine, tried on a small copy of the project.

kill -9 in every stage; full disks, folders without write permission; paths with a space or
other letters; OpenFOAM missing or too old; two makes at once; damaged inputs.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

from pipeline.runs.run import open_run
from tests.studies.faults import conditions, kill
from tests.studies.faults.damaged import damaged_inputs
from tests.studies.faults.project import LEVEL, SCENE, TARGETS, copy_project, make
from tests.studies.pages import write_table
from tests.studies.stability import page

KILL_COLUMNS = ("stage", "kills", "runs_compared", "difference", "date")
CONDITION_COLUMNS = ("condition", "stage", "ended", "sentence", "afterwards", "date")
DAMAGE_COLUMNS = ("stage", "input", "ways", "refused", "sentence")
GOOD = ("", "works", "as undisturbed")


def _make_before(project: Path, stage: str) -> None:
    """Make what a stage needs."""
    if stage != TARGETS[0]:
        done = make(project, f"{SCENE}.{TARGETS[TARGETS.index(stage) - 1]}")
        assert done.returncode == 0, done.stderr[-2000:]


def _reported(rows: Iterable[kill.Row]) -> list[kill.Row]:
    """Print each row when it is there, and date it."""
    done = []
    for row in rows:
        done.append({"date": datetime.now(UTC).date().isoformat()} | row)
        print("; ".join(str(value) for value in row.values()), flush=True)
    return done


def main() -> int:
    """Command line; 1 where a file was lost or half-written, or no single sentence says why."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.faults", description=__doc__)
    parser.add_argument("--kills", type=int, default=6, help="in each stage (default: %(default)s)")
    parser.add_argument("--stages", help="names with commas (default: all)")
    parts = ("kills", "conditions", "damaged")
    parser.add_argument("--only", choices=parts, help="(default: all, and the page)")
    parser.add_argument("--seed", type=int, default=0, help="of the kills (default: %(default)s)")
    parser.add_argument("--tables", type=Path, default=Path("docs/stability"), help="their folder")
    parser.add_argument("--folder", type=Path, help="of the project's copy (default: temporary)")
    args = parser.parse_args()
    stages = args.stages.split(",") if args.stages else TARGETS
    failures = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.folder or Path(temporary)
        project, wanted = folder / "project", folder / "wanted"
        if not project.exists():
            copy_project(project)
        durations = kill.undisturbed(project, wanted)

        def kills() -> Iterable[kill.Row]:
            for stage in stages:
                _make_before(project, stage)
                seed, log = f"{args.seed}{stage}", folder / "log"
                times = durations[stage], args.kills
                yield kill.kills_in(project, wanted, stage, *times, seed, log)

        if args.only in (None, "kills"):
            rows = _reported(kills())
            failures += sum(bool(row["difference"]) for row in rows)
            write_table(args.tables / "stage_kills.csv", KILL_COLUMNS, rows)
            _make_before(project, "report")
        if args.only in (None, "conditions"):
            rows = _reported(conditions.all_conditions(project, wanted, folder, stages))
            failures += sum(r["ended"] == "wrong" or r["afterwards"] not in GOOD for r in rows)
            write_table(args.tables / "faults.csv", CONDITION_COLUMNS, rows)
        if args.only in (None, "damaged"):
            rows = _reported(damaged_inputs(open_run(project / "cases" / SCENE, LEVEL)))
            failures += sum(row["refused"] != row["ways"] for row in rows)
            write_table(args.tables / "damaged.csv", DAMAGE_COLUMNS, rows)
    if args.only is None:
        page.write(args.tables.parent)
    print(f"{failures} failures")
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
