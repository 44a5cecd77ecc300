"""`make faults`: what kills, disks, damaged and foreign files do to every stage of a small run."""

import argparse
import sys
import tempfile
from importlib import import_module
from pathlib import Path

import pandas as pd

from docs.evidence.faults.campaign import COLUMNS, TARGETS, Campaign
from docs.evidence.faults.parts import PARTS, replaced
from docs.evidence.stability import page
from pipeline.runs.stages import STAGES
from piv.files.command import guarded
from piv.files.errors import StageError
from postprocess.tables import write_table

TABLE = Path("docs/stability/faults.csv")


def main() -> int:
    """Command line; 1 where a fault ended in another way than a stage may."""
    parser = argparse.ArgumentParser(prog="python -m docs.evidence.faults", description=__doc__)
    parser.add_argument("--kills", type=int, default=5, help="in each stage (default: %(default)s)")
    parser.add_argument("--parts", default=",".join(PARTS), help="default: %(default)s")
    parser.add_argument("--stages", default=",".join(TARGETS), help="default: %(default)s")
    parser.add_argument("--seed", type=int, default=0, help="of the kills (default: %(default)s)")
    args = parser.parse_args()
    parts, chosen = args.parts.split(","), args.stages.split(",")
    if unknown := [name for name in (*parts, *chosen) if name not in (*PARTS, *TARGETS)]:
        raise StageError(f"{unknown[0]}: no such part or stage; --help lists them")
    for stage in STAGES:  # once, not in each of a thousand processes
        import_module(stage.module)
    rows = []
    last = max([*chosen, *(["sheet"] if "paths" in parts else [])], key=TARGETS.index)
    with tempfile.TemporaryDirectory() as folder:
        at = Campaign(Path(folder), last)
        for part in parts:
            for row in PARTS[part][1](at, chosen, args.kills, args.seed):
                rows.append(row)
                print("; ".join(map(str, row.values())), flush=True)
    table = pd.DataFrame(rows, columns=COLUMNS, dtype=object)
    if TABLE.exists():  # a part leaves the rows of the others
        old = pd.read_csv(TABLE, dtype=object, keep_default_na=False)
        table = pd.concat([replaced(old, parts, chosen), table])
    write_table(TABLE, table)
    page.write(TABLE.parent)
    wrong = sum(row["wrong"] for row in rows)
    print(f"{sum(row['times'] for row in rows)} faults, {wrong} ended wrongly")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(guarded("faults", main, strict=True))
