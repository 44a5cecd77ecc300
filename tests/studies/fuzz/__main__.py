"""Fuzz of the readers: every damaged file is read or refused in one sentence, never anything else.

`python -m tests.studies.fuzz` runs each reader in a process of its own, guided by coverage where atheris is installed, else with
random changes; it writes a table, keeps each input that broke a reader, and exits 1 where one did.
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
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from fileio.atomic import whole, write_bytes

COLUMNS = ("reader", "engine", "inputs", "read", "refused", "faults", "cpu_s", "date")
NOTE_EVERY = 500  # inputs
TIME_LIMIT = 900  # s for one input, on a machine that is busy with other things
MEMORY_MB = 6000


class Tally:
    """Counts of one reader's outcomes, noted to a file as they come: a crash must not lose them."""

    def __init__(self, target, folder: Path, kept: Path) -> None:
        self.target, self.folder, self.kept = target, folder, kept
        self.counts = {"inputs": 0, "read": 0, "refused": 0, "faults": 0}
        self.seen: set[str] = set()

    def one(self, content: bytes) -> None:
        """Try one input."""
        from tests.studies.fuzz.targets import Fault, check

        self.counts["inputs"] += 1
        try:
            outcome = check(self.target, content, self.folder)
            self.counts["read" if outcome is None else "refused"] += 1
        except Fault as fault:
            self.counts["faults"] += 1
            self._keep(str(fault), content)
        if self.counts["inputs"] % NOTE_EVERY == 0:
            self.note()

    def _keep(self, message: str, content: bytes) -> None:
        """Save the first input of each kind of fault."""
        kind = re.sub(r"[\d'\"].*", "", message.replace(str(self.folder), ""))
        if kind in self.seen:
            return
        self.seen.add(kind)
        name = f"{hashlib.sha256(content).hexdigest()[:8]}-{self.target.name}"
        write_bytes(self.kept / name, content)
        write_bytes(self.kept / (name + ".txt"), f"{message}\n".encode(errors="replace"))

    def note(self) -> None:
        """Write the counts beside the reader's folder."""
        spent = time.process_time()
        text = json.dumps(self.counts | {"cpu_s": round(spent, 1)})
        write_bytes(self.folder.with_suffix(".json"), text.encode(), sync=False)


def fuzz_one(name: str, inputs: int, seed: int, engine: str, work: Path, kept: Path) -> None:
    """Fuzz one reader in this process."""
    if engine == "atheris":
        import atheris

        with atheris.instrument_imports(include=["piv", "pipeline"]):
            pass
    from tests.studies.fuzz.mutate import damaged
    from tests.studies.fuzz.targets import named, quiet_libraries

    target = named(name)
    inputs = max(1, inputs // target.costs)
    folder, corpus = work / "files", work / "corpus"
    folder.mkdir()
    corpus.mkdir()
    (work / "seeds").mkdir()
    seeds = target.seeds(work / "seeds")
    for k, content in enumerate(seeds):
        (corpus / f"seed{k}").write_bytes(content)
    tally = Tally(target, folder, kept)
    quiet_libraries()
    if engine == "random":
        draw = random.Random(seed)
        current = kept / f"crash-{name}"  # what is left here, the process did not survive
        kept.mkdir(parents=True, exist_ok=True)
        for _ in range(inputs):
            content = damaged(seeds, draw)
            current.write_bytes(content)
            tally.one(content)
        current.unlink(missing_ok=True)
        tally.note()
        return
    kept.mkdir(parents=True, exist_ok=True)
    arguments = [
        f"-runs={inputs}", f"-seed={seed + 1}", f"-timeout={TIME_LIMIT}", f"-rss_limit_mb={MEMORY_MB}",
        f"-artifact_prefix={kept}/crash-{name}-", f"-max_len={4 * max(map(len, seeds))}", "-print_final_stats=0",
    ]  # fmt: skip
    import atexit

    atexit.register(tally.note)
    atheris.Setup([sys.argv[0], *arguments, str(corpus)], tally.one)
    atheris.Fuzz()  # ends the process


def run_reader(name: str, args: argparse.Namespace) -> dict[str, object]:
    """Fuzz one reader in a process of its own; its row of the table."""
    with tempfile.TemporaryDirectory(
        dir="/dev/shm" if Path("/dev/shm").is_dir() else None
    ) as temporary:
        command = [
            sys.executable, "-m", "tests.studies.fuzz", "--one", name, "--inputs", str(args.inputs), "--seed", str(args.seed),
            "--engine", args.engine, "--work", temporary, "--kept", str(args.kept.resolve()),
        ]  # fmt: skip
        done = subprocess.run(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False
        )
        note = Path(temporary) / "files.json"
        counts = json.loads(note.read_text()) if note.exists() else {}
    counts = {"inputs": 0, "read": 0, "refused": 0, "faults": 0, "cpu_s": 0.0} | counts
    if done.returncode != 0:
        counts["faults"] += 1  # a crash, a hang or too much memory
        print(
            f"{name}: ended with {done.returncode}\n{done.stderr.decode(errors='replace')[-2000:]}"
        )
    label = f"atheris {version('atheris')}" if args.engine == "atheris" else "random"
    today = datetime.now(UTC).date().isoformat()
    return {"reader": name, "engine": label, "date": today} | counts


def merged(table: Path, rows: list[dict[str, object]]) -> list[dict[str, object]]:
    """The rows of a table that is there, with those of the same readers and engine replaced by `rows`."""
    with table.open(encoding="utf-8", newline="") as file:
        old: list[dict[str, object]] = list(csv.DictReader(file))
    new = {(row["reader"], row["engine"]): row for row in rows}
    kept = [new.pop((row["reader"], row["engine"]), row) for row in old]
    return kept + list(new.values())


def main() -> int:
    """Command line; 1 where a reader broke."""
    guided = "atheris" if find_spec("atheris") else "random"
    parser = argparse.ArgumentParser(prog="python -m tests.studies.fuzz", description=__doc__)
    parser.add_argument(
        "--inputs", type=int, default=5000, help="inputs per reader (default: %(default)s)"
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="of the random changes (default: %(default)s)"
    )
    parser.add_argument(
        "--engine", choices=("atheris", "random"), default=guided, help="(default: %(default)s)"
    )
    parser.add_argument("--readers", help="names with commas (default: all)")
    parser.add_argument(
        "--table", type=Path, help="CSV to write the counts to; with --readers, their rows"
    )
    parser.add_argument(
        "--kept",
        type=Path,
        default=Path("tests/studies/fuzz/out"),
        help="where inputs that broke a reader go",
    )
    parser.add_argument("--one", help=argparse.SUPPRESS)
    parser.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.one:
        fuzz_one(args.one, args.inputs, args.seed, args.engine, args.work, args.kept)
        return 0
    from tests.studies.fuzz.targets import TARGETS

    names = args.readers.split(",") if args.readers else [target.name for target in TARGETS]
    rows = []
    print(
        f"{'reader':18}{'inputs':>8}{'read':>8}{'refused':>9}{'faults':>8}{'CPU s':>8}", flush=True
    )
    for name in names:
        rows.append(run_reader(name, args))
        r = rows[-1]
        print(
            f"{name:18}{r['inputs']:>8}{r['read']:>8}{r['refused']:>9}{r['faults']:>8}{r['cpu_s']:>8}",
            flush=True,
        )
    total, broken = (sum(int(str(r[key])) for r in rows) for key in ("inputs", "faults"))
    print(
        f"{total} inputs, {broken} faults" + (f"; the inputs are in {args.kept}" if broken else "")
    )
    if args.table:
        rows = merged(args.table, rows) if args.readers else rows
        with whole(args.table) as part, part.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
