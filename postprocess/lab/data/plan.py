"""What a comparison has to solve, and how long that takes, before anything is solved."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.runs.estimate import duration, estimate
from pipeline.runs.run import Run
from postprocess.lab.data.inputs_toml import Input, Inputs, Numerics

SET_UP = ("kinematics", "mesh", "case")  # stages before the solver
FIXED = 10.0  # CPU s of a run that cells and steps do not change (half of a run at most)
# A grid finer by r has r^(d - GRADED) times the cells: 1.8 at smoke, 2.5 to 2.9 at finer levels.
GRADED = 0.5


def _work(one: Input | Numerics, dimensions: int) -> tuple[float, float]:
    """Cells and steps of a run beside the nominal one over the nominal run's."""
    if isinstance(one, Input):
        return 1.0, 1.0
    return (one.ratio ** (dimensions - GRADED), 1.0) if one.name == "grid" else (1.0, one.ratio)


def _solving_time(took: dict[str, float], works: list[tuple[float, float]], ranks: int) -> float:
    """Time (s) of runs on idle cores; `took`: CPU s of the nominal run's stages.

    Before the solver one process works, whatever the ranks.
    """
    fixed = min(FIXED, 0.5 * took["run"])
    time = 0.0
    for cells, steps in works:
        time += took["kinematics"] + took["case"] + took["mesh"] * cells
        time += (fixed + (took["run"] - fixed) * cells * steps) / ranks
    return time


def plan_text(run: Run, beside: Mapping[str, Run], inputs: Inputs, ranks: int) -> str:
    """The solved and the missing runs of a comparison, with the time of the latter.

    `beside`: the runs that vary one of the `inputs` each, by name. The times are those of the
    nominal run, or as predicted for it.
    """
    nominal = run.why_stale("run") is None
    missing = [one for one in inputs.all if beside[one.name].why_stale("run") is not None]
    there = ["the nominal run"] if nominal else []
    there += [one.name for one in inputs.all if one not in missing]
    text = f"plan: solved already: {', '.join(there) or 'nothing'}; "
    if not missing and nominal:
        return f"{text}nothing is left to solve"
    wanted = ([] if nominal else ["the nominal run"]) + [one.name for one in missing]
    text += f"to be solved: {', '.join(wanted)}"
    took = {stage: estimate(run, stage)[0] for stage in (*SET_UP, "run")}
    by = "by the nominal run's cost" if nominal else "by the time predicted for the nominal run"
    # a plane grid is made finer in two directions only
    dimensions = 2 if run.scene.model.kind == "2d" else 3
    works = [_work(one, dimensions) for one in missing] + [(1.0, 1.0)] * (not nominal)
    time = duration(_solving_time(took, works, ranks))
    return f"{text}, about {time} on {ranks} idle cores, {by}"
