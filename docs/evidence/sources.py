"""Record that the results of stages are unchanged, though their sources did change.

python -m docs.evidence.sources STAGE ...

Without a stage: those whose version was raised. The other stages that take long keep their results
when their code changes, until their version in pipeline/runs/stages.py is raised.
"""

import csv
import sys
from pathlib import Path

from docs.evidence.small_scene import ROOT
from pipeline.runs.sources import sources_digest
from pipeline.runs.stages import BY_NAME, COUPLED

TABLE = ROOT / "tests" / "unit" / "runs" / "sources.csv"
_COLUMNS = ("stage", "version", "sources")


def present(root: Path = ROOT) -> dict[str, tuple[str, ...]]:
    """Version and digest of the sources of each stage whose results outlive a change of code."""
    return {
        f"{name}{kind}": (str(stage.version), sources_digest(stage.module, root))
        for kind, rows in (("", BY_NAME), ("_coupled", COUPLED))
        for name, stage in rows.items()
        if not stage.by_sources
    }


def recorded() -> dict[str, tuple[str, ...]]:
    """Version and digest of those sources from which the results are known."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        return {stage: tuple(row) for stage, *row in list(csv.reader(file))[1:]}


def main(unchanged: list[str]) -> int:
    """Record stages that are named or have a new version; returns the number of the others."""
    old, new = recorded(), present()
    settled = {name for name in new if name in unchanged or old.get(name, "?")[0] != new[name][0]}
    done = {name: new[name] if name in settled else old[name] for name in new}
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        rows = [_COLUMNS, *((name, *row) for name, row in done.items())]
        csv.writer(file, lineterminator="\n").writerows(rows)
    for name in (left := [name for name in new if done[name] != new[name]]):
        print(f"{name}: raise its version, or name it here where its results are unchanged")
    return len(left)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
