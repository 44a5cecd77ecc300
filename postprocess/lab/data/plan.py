"""What a comparison has to solve, and how long that takes, before anything is solved."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.runs.estimate import duration, estimate
from pipeline.runs.run import Run
from pipeline.runs.stages import BY_NAME

STAGES = ("kinematics", "mesh", "case", "run")


def plan_text(runs: Mapping[str, Run], ranks: int) -> str:
    """The solved and the missing runs of a comparison by name, with the time of the latter."""
    missing = [name for name, run in runs.items() if run.why_stale("run") is not None]
    there = ", ".join(name for name in runs if name not in missing) or "nothing"
    if not missing:
        return f"plan: solved already: {there}; nothing is left to solve"
    time = sum(
        estimate(runs[name], stage)[0] / (ranks if BY_NAME[stage].ranks else 1)
        for name in missing
        for stage in STAGES
    )
    wanted = f"to be solved: {', '.join(missing)}, about {duration(time)} on {ranks} idle cores"
    return f"plan: solved already: {there}; {wanted}"
