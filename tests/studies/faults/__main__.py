"""`make faults`: what kills, disks, damaged and foreign files do to every stage of a small run."""

from __future__ import annotations

import argparse
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path

from pipeline.runs.stages import STAGES
from tests.studies.faults import campaign
from tests.studies.pages import write_table
from tests.studies.stability import page


def part(name: str, folder: Path, chosen: list[str], kills: int, seed: int) -> list[campaign.Row]:
    """The rows of one half of the faults, printed as they come."""
    for stage in STAGES:  # once, not in each of a thousand processes
        import_module(stage.module)
    at, rows = campaign.Campaign(folder / name), []
    more = (kills, seed) if name == "of_processes" else ()
    for row in getattr(campaign, name)(at, chosen, *more):
        rows.append(row)
        print("; ".join(str(value) for value in row.values()), flush=True)
    return rows


def main() -> int:
    """Command line; 1 where a fault ended in another way than `campaign` allows."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.faults", description=__doc__)
    parser.add_argument("--kills", type=int, default=5, help="in each stage (default: %(default)s)")
    parser.add_argument("--stages", help="names with commas: only these, and no page")
    parser.add_argument("--seed", type=int, default=0, help="of the kills (default: %(default)s)")
    parser.add_argument("--docs", type=Path, default=Path("docs"), help="folder of the page")
    args = parser.parse_args()
    chosen = args.stages.split(",") if args.stages else campaign.TARGETS
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(2, get_context("fork")) as pool,
    ):
        names = ("of_processes", "of_files")
        works = [
            pool.submit(part, name, Path(folder), chosen, args.kills, args.seed) for name in names
        ]
        rows = [row for work in works for row in work.result()]
    if not args.stages:
        write_table(args.docs / "stability" / "faults.csv", campaign.COLUMNS, rows)
        page.write(args.docs)
    wrong = sum(row["wrong"] for row in rows)
    print(f"{sum(row['times'] for row in rows)} faults, {wrong} ended wrongly")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
