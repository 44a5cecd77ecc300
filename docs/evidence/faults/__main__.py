"""`make faults`: what kills, disks, damaged and foreign files do to every stage of a small run."""

import argparse
import sys
import tempfile
from importlib import import_module
from itertools import chain
from pathlib import Path

import pandas as pd

from docs.evidence.faults import campaign
from docs.evidence.stability import page
from pipeline.runs.stages import STAGES
from postprocess.tables import write_table


def main() -> int:
    """Command line; 1 where a fault ended in another way than `campaign` allows."""
    parser = argparse.ArgumentParser(prog="python -m docs.evidence.faults", description=__doc__)
    parser.add_argument("--kills", type=int, default=5, help="in each stage (default: %(default)s)")
    parser.add_argument("--stages", help="names with commas: only these, and no page")
    parser.add_argument("--seed", type=int, default=0, help="of the kills (default: %(default)s)")
    args = parser.parse_args()
    chosen = args.stages.split(",") if args.stages else campaign.TARGETS
    for stage in STAGES:  # once, not in each of a thousand processes
        import_module(stage.module)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        at = campaign.Campaign(Path(folder))
        processes = campaign.of_processes(at, chosen, args.kills, args.seed)
        for row in chain(processes, campaign.of_files(at, chosen)):
            rows.append(row)
            print("; ".join(map(str, row.values())), flush=True)
    if not args.stages:
        table = pd.DataFrame(rows, columns=campaign.COLUMNS, dtype=object)
        write_table(Path("docs/stability/faults.csv"), table)
        page.write(Path("docs/stability"))
    wrong = sum(row["wrong"] for row in rows)
    print(f"{sum(row['times'] for row in rows)} faults, {wrong} ended wrongly")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
