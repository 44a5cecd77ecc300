"""What a stage cost, in costs/<stage>.json."""

from __future__ import annotations

import resource
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path


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
    from fileio.formats.records import (
        COST,
    )  # slow to load, and not needed before the stage has ended

    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    cost = {
        "stage": stage,
        "wall_time": round(earlier.wall_time + wall_time, 3),
        "cpu_time": round(
            earlier.cpu_time + sum(usage.ru_utime + usage.ru_stime for usage in usages), 3
        ),
        "peak_memory": max(usage.ru_maxrss for usage in usages) * 1024,
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    COST.write(path, cost)
