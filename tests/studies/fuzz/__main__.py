"""Fuzz of the readers: every damaged file is read, or refused in one sentence.

Each reader runs in a process of its own. The exit code is 1 where one broke; the input that broke
it is kept.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import random
import re
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from fileio.atomic import write_bytes
from tests.studies.fuzz.mutate import damaged
from tests.studies.fuzz.targets import TARGETS, Fault, check, named, quiet_libraries
from tests.studies.pages import write_table

COLUMNS = ("reader", "inputs", "read", "refused", "faults", "cpu_s", "date")
KEPT = Path("tests/studies/fuzz/out")


def fuzz_one(name: str, inputs: int, seed: int, work: Path, kept: Path) -> dict[str, Any]:
    """Fuzz a reader in this process; keeps the first input of each kind of fault."""
    target, draw, seen = named(name), random.Random(seed), set()
    for folder in (work / "files", work / "seeds", kept):
        folder.mkdir(parents=True, exist_ok=True)
    seeds = target.seeds(work / "seeds")
    counts = dict.fromkeys(("inputs", "read", "refused", "faults"), 0)
    current = kept / f"crash-{name}"  # remains if the process does not survive it
    quiet_libraries()
    for _ in range(max(1, inputs // target.costs)):
        content = damaged(seeds, draw)
        current.write_bytes(content)
        counts["inputs"] += 1
        try:
            refusal = check(target, content, work / "files")
            counts["read" if refusal is None else "refused"] += 1
        except Fault as fault:
            counts["faults"] += 1
            kind = re.sub(r"[\d'\"].*", "", str(fault).replace(str(work), ""))
            if kind not in seen:
                seen.add(kind)
                path = kept / f"{hashlib.sha256(content).hexdigest()[:8]}-{name}"
                write_bytes(path, content)
                write_bytes(path.with_name(path.name + ".txt"), f"{fault}\n".encode())
    current.unlink(missing_ok=True)
    return counts | {"cpu_s": round(time.process_time(), 1)}


def run_reader(name: str, args: argparse.Namespace) -> dict[str, Any]:
    """Fuzz one reader in a process of its own; its row of the table."""
    memory = "/dev/shm" if Path("/dev/shm").is_dir() else None
    counts: dict[str, Any] = dict.fromkeys(COLUMNS[1:6], 0)
    with tempfile.TemporaryDirectory(dir=memory) as work:
        command = [
            sys.executable, "-m", "tests.studies.fuzz", "--one", name, "--work", work,
            "--inputs", str(args.inputs), "--seed", str(args.seed),
            "--kept", str(args.kept.resolve()),
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, errors="replace")
    if done.returncode == 0:
        counts |= json.loads(done.stdout)
    else:  # a crash
        counts["faults"] += 1
        print(f"{name}: ended with {done.returncode}\n{done.stderr[-2000:]}")
    row = {"reader": name, **counts, "date": datetime.now(UTC).date().isoformat()}
    print("  ".join(str(row[key]) for key in COLUMNS[:-1]), flush=True)
    return row


def merged(table: Path, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows of an existing table, with those of the same readers replaced."""
    with table.open(encoding="utf-8", newline="") as file:
        return list({row["reader"]: row for row in [*csv.DictReader(file), *rows]}.values())


def main() -> int:
    """Command line; 1 where a reader broke."""
    default = "(default: %(default)s)"
    parser = argparse.ArgumentParser(prog="python -m tests.studies.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=5000, help=f"per reader {default}")
    parser.add_argument("--seed", type=int, default=0, help=f"of the random changes {default}")
    parser.add_argument("--readers", help="names with commas (default: all)")
    parser.add_argument("--table", type=Path, help="CSV; with --readers only their rows change")
    parser.add_argument("--kept", type=Path, default=KEPT, help="folder of inputs that broke one")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    parser.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.one:
        print(json.dumps(fuzz_one(args.one, args.inputs, args.seed, args.work, args.kept)))
        return 0
    names = args.readers.split(",") if args.readers else [target.name for target in TARGETS]
    print("  ".join(COLUMNS[:-1]), flush=True)
    rows = [run_reader(name, args) for name in names]
    total, broken = (sum(row[key] for row in rows) for key in ("inputs", "faults"))
    print(f"{total} inputs, {broken} faults; inputs that broke a reader: {args.kept}")
    if args.table:
        write_table(args.table, COLUMNS, merged(args.table, rows) if args.readers else rows)
    return int(broken > 0)


if __name__ == "__main__":
    sys.exit(main())
