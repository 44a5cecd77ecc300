"""Fuzz of the readers: every damaged file is read, or refused in one sentence.

Each reader runs in a process of its own. The exit code is 1 where one broke; the input that broke
it is kept.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import random
import re
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from tests.studies.fuzz.mutate import damaged
from tests.studies.fuzz.targets import TARGETS, Fault, check, named, quiet_libraries
from tests.studies.pages import write_table

COLUMNS = ("reader", "inputs", "read", "refused", "faults", "cpu_s", "date")
KEPT = Path("tests/studies/fuzz/out")


def fuzz(name: str, inputs: int, seed: int) -> dict[str, Any]:
    """Counts of a reader; the first input of each kind of fault is kept, with its text."""
    quiet_libraries()
    target, draw, seen = named(name), random.Random(seed), set()
    counts = dict.fromkeys(COLUMNS[1:5], 0)
    KEPT.mkdir(parents=True, exist_ok=True)
    current = KEPT / f"crash-{name}"  # remains if the process does not survive it
    memory = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with (
        tempfile.TemporaryDirectory(dir=memory) as seeds,
        tempfile.TemporaryDirectory(dir=memory) as files,
    ):
        valid = target.seeds(Path(seeds))
        for _ in range(max(1, inputs // target.costs)):
            content = damaged(valid, draw)
            current.write_bytes(content)
            counts["inputs"] += 1
            try:
                refusal = check(target, content, Path(files))
                counts["read" if refusal is None else "refused"] += 1
            except Fault as fault:
                counts["faults"] += 1
                kind = re.sub(r"[\d'\"].*", "", str(fault).replace(files, ""))
                if kind not in seen:
                    seen.add(kind)
                    path = KEPT / f"{hashlib.sha256(content).hexdigest()[:8]}-{name}"
                    path.write_bytes(content)
                    path.with_name(f"{path.name}.txt").write_text(f"{fault}\n")
    current.unlink()
    return counts | {"cpu_s": round(time.process_time(), 1)}


def main() -> int:
    """Command line; 1 where a reader broke."""
    default = "(default: %(default)s)"
    parser = argparse.ArgumentParser(prog="python -m tests.studies.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=5000, help=f"per reader {default}")
    parser.add_argument("--seed", type=int, default=0, help=f"of the random changes {default}")
    parser.add_argument("--readers", help="names with commas (default: all)")
    parser.add_argument("--table", type=Path, help="CSV, of which the rows of these readers change")
    args = parser.parse_args()
    names = args.readers.split(",") if args.readers else [target.name for target in TARGETS]
    print("  ".join(COLUMNS), flush=True)
    rows: dict[str, dict[str, Any]] = {}
    for name in names:
        row: dict[str, Any] = {"reader": name} | dict.fromkeys(COLUMNS[1:], 0) | {"faults": 1}
        with ProcessPoolExecutor(1, get_context("fork")) as pool:
            try:
                row |= pool.submit(fuzz, name, args.inputs, args.seed).result()
            except BrokenProcessPool as error:
                print(f"{name}: {error}")
        rows[name] = row | {"date": datetime.now(UTC).date().isoformat()}
        print("  ".join(map(str, rows[name].values())), flush=True)
    faults = sum(row["faults"] for row in rows.values())
    print(f"{faults} faults; inputs that broke a reader: {KEPT}")
    if args.table:
        with args.table.open(encoding="utf-8", newline="") as file:
            known = {row["reader"]: row for row in csv.DictReader(file)}
        write_table(args.table, COLUMNS, list((known | rows).values()))
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
