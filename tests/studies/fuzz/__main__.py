"""Fuzz of the readers: every damaged file is read, or refused in one sentence.

Each reader runs in a process of its own, guided by coverage where atheris is installed, else with
random changes. The exit code is 1 where one broke; the input that broke it is kept.
"""

from __future__ import annotations

import argparse
import atexit
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
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from fileio.atomic import write_bytes
from tests.studies.pages import write_table

COLUMNS = ("reader", "engine", "inputs", "read", "refused", "faults", "cpu_s", "date")
NOTE_EVERY = 500  # inputs
TIME_LIMIT = 900  # s for one input, on a busy machine
MEMORY_MB = 6000
KEPT = Path("tests/studies/fuzz/out")


class Tally:
    """Counts of one reader's outcomes, saved now and then: a crash must not lose them."""

    def __init__(self, target, folder: Path, kept: Path) -> None:
        self.target, self.folder, self.kept = target, folder, kept
        self.counts = dict.fromkeys(("inputs", "read", "refused", "faults"), 0)
        self.seen: set[str] = set()

    def one(self, content: bytes) -> None:
        """Try one input; keep the first input of each kind of fault."""
        from tests.studies.fuzz.targets import Fault, check

        self.counts["inputs"] += 1
        try:
            refusal = check(self.target, content, self.folder)
            self.counts["read" if refusal is None else "refused"] += 1
        except Fault as fault:
            self.counts["faults"] += 1
            kind = re.sub(r"[\d'\"].*", "", str(fault).replace(str(self.folder), ""))
            if kind not in self.seen:
                self.seen.add(kind)
                path = self.kept / f"{hashlib.sha256(content).hexdigest()[:8]}-{self.target.name}"
                write_bytes(path, content)
                text = f"{fault}\n".encode(errors="replace")
                write_bytes(path.with_name(path.name + ".txt"), text)
        if self.counts["inputs"] % NOTE_EVERY == 0:
            self.note()

    def note(self) -> None:
        """Write the counts beside the reader's folder."""
        text = json.dumps(self.counts | {"cpu_s": round(time.process_time(), 1)})
        write_bytes(self.folder.with_suffix(".json"), text.encode(), sync=False)


def fuzz_one(args: argparse.Namespace) -> None:
    """Fuzz the reader `args.one` in this process."""
    name, work, kept = args.one, args.work, args.kept
    if args.engine == "atheris":
        import atheris

        with atheris.instrument_imports(include=["piv", "pipeline"]):
            pass
    from tests.studies.fuzz.mutate import damaged
    from tests.studies.fuzz.targets import named, quiet_libraries

    target = named(name)
    inputs = max(1, args.inputs // target.costs)
    for folder in (work / "files", work / "corpus", work / "seeds", kept):
        folder.mkdir(parents=True, exist_ok=True)
    seeds = target.seeds(work / "seeds")
    tally = Tally(target, work / "files", kept)
    quiet_libraries()
    if args.engine == "random":
        draw = random.Random(args.seed)
        current = kept / f"crash-{name}"  # remains if the process does not survive it
        for _ in range(inputs):
            content = damaged(seeds, draw)
            current.write_bytes(content)
            tally.one(content)
        current.unlink(missing_ok=True)
        tally.note()
        return
    for k, content in enumerate(seeds):
        (work / "corpus" / f"seed{k}").write_bytes(content)
    options = {
        "runs": inputs, "seed": args.seed + 1, "timeout": TIME_LIMIT, "rss_limit_mb": MEMORY_MB,
        "artifact_prefix": f"{kept}/crash-{name}-", "max_len": 4 * max(map(len, seeds)),
        "print_final_stats": 0,
    }  # fmt: skip
    arguments = [f"-{key}={value}" for key, value in options.items()]
    atexit.register(tally.note)
    atheris.Setup([sys.argv[0], *arguments, str(work / "corpus")], tally.one)
    atheris.Fuzz()  # ends the process


def run_reader(name: str, args: argparse.Namespace) -> dict[str, Any]:
    """Fuzz one reader in a process of its own; its row of the table."""
    memory = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with tempfile.TemporaryDirectory(dir=memory) as work:
        command = [
            sys.executable, "-m", "tests.studies.fuzz", "--one", name, "--engine", args.engine,
            "--inputs", str(args.inputs), "--seed", str(args.seed),
            "--work", work, "--kept", str(args.kept.resolve()),
        ]  # fmt: skip
        done = subprocess.run(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False
        )
        note = Path(work) / "files.json"
        counts = json.loads(note.read_text()) if note.exists() else {}
    counts = dict.fromkeys(COLUMNS[2:7], 0) | counts
    if done.returncode != 0:
        counts["faults"] += 1  # a crash, a hang or too much memory
        end = done.stderr.decode(errors="replace")[-2000:]
        print(f"{name}: ended with {done.returncode}\n{end}")
    label = f"atheris {version('atheris')}" if args.engine == "atheris" else "random"
    row = {"reader": name, "engine": label, **counts, "date": datetime.now(UTC).date().isoformat()}
    print("  ".join(str(row[key]) for key in COLUMNS[:-1]), flush=True)
    return row


def merged(table: Path, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows of an existing table, with those of the same readers and engine replaced."""
    with table.open(encoding="utf-8", newline="") as file:
        both = [*csv.DictReader(file), *rows]
    return list({(row["reader"], row["engine"]): row for row in both}.values())


def main() -> int:
    """Command line; 1 where a reader broke."""
    guided = "atheris" if find_spec("atheris") else "random"
    default = "(default: %(default)s)"
    parser = argparse.ArgumentParser(prog="python -m tests.studies.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=5000, help=f"per reader {default}")
    parser.add_argument("--seed", type=int, default=0, help=f"of the random changes {default}")
    parser.add_argument("--engine", choices=("atheris", "random"), default=guided, help=default)
    parser.add_argument("--readers", help="names with commas (default: all)")
    parser.add_argument("--table", type=Path, help="CSV; with --readers only their rows change")
    parser.add_argument("--kept", type=Path, default=KEPT, help="folder of inputs that broke one")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    parser.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.one:
        fuzz_one(args)
        return 0
    from tests.studies.fuzz.targets import TARGETS

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
