"""What a stage cost, in costs/<stage>.json; also as a command around one that keeps no account of its own.

Command: python -m fileio.cost cases/single_finger/out/coarse/costs/piv.json -- python -m piv correlate …
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from fileio.atomic import write_text
from fileio.errors import sentence


@dataclass(frozen=True)
class Spent:
    """Wall and CPU time (user + system), s."""

    wall_time: float = 0.0
    cpu_time: float = 0.0

    def __add__(self, other: Spent) -> Spent:
        return Spent(self.wall_time + other.wall_time, self.cpu_time + other.cpu_time)


NOTHING = Spent()


def record_cost(path: Path, stage: str, wall_time: float, earlier: Spent = NOTHING) -> None:
    """Write wall time (s), CPU time (s) and peak memory (bytes) of this process and its children; with `earlier`, what a
    run that this one resumed had spent.
    """
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    cost = {
        "stage": stage,
        "wall_time": round(earlier.wall_time + wall_time, 3),
        "cpu_time": round(earlier.cpu_time + sum(usage.ru_utime + usage.ru_stime for usage in usages), 3),
        "peak_memory": max(usage.ru_maxrss for usage in usages) * 1024,
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    write_text(path, json.dumps(cost, indent=1) + "\n")


def main(argv: list[str]) -> int:
    """Run the command after `--`; its exit code is passed on, and a cost is recorded of what ended well."""
    if len(argv) < 3 or argv[1] != "--":
        print("usage: python -m fileio.cost PATH.json -- COMMAND …", file=sys.stderr)
        return 2
    begin = time.monotonic()
    code = subprocess.run(argv[2:]).returncode
    if code == 0:
        path = Path(argv[0])
        try:
            record_cost(path, path.stem, time.monotonic() - begin)
        except OSError as error:
            print(f"costs: {sentence(error)}", file=sys.stderr)
            return 2
    return code


@contextmanager
def cost_recorded(out: Path, stage: str) -> Iterator[None]:
    """Record the cost in costs/<stage>.json of the folder `out` when the block ends well."""
    begin = time.monotonic()
    yield
    record_cost(out / "costs" / f"{stage}.json", stage, time.monotonic() - begin)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
