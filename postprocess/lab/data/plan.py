"""What a comparison has to solve, and how long that takes, before anything is solved."""

from __future__ import annotations

from fileio.formats.records import COST
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.lab.data.inputs_toml import Input, Inputs, Numerics

SET_UP = ("kinematics", "mesh", "case")  # stages before the solver
FIXED = 10.0  # CPU s of a run that cells and steps do not change (half of a run at most)
# A grid finer by r has r^(d - GRADED) times the cells: 1.8 at smoke, 2.5 to 2.9 at finer levels.
GRADED = 0.5
PREDICT = "is not known yet (make predict estimates it)"


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


def plan_text(files: StageFiles, inputs: Inputs, ranks: int, solver: float | None = None) -> str:
    """The solved and the missing runs of a scene, with the time of the latter.

    `solver`: predicted time (s) of the nominal run's solver on one rank, used until it has run.
    """
    nominal = (files.out / "run" / "run.json").exists()
    missing = [one for one in inputs.all if not _solved(files, one.name)]
    there = ["the nominal run"] if nominal else []
    there += [one.name for one in inputs.all if one not in missing]
    text = f"plan: solved already: {', '.join(there) or 'nothing'}; "
    if not missing and nominal:
        return f"{text}nothing is left to solve"
    wanted = ([] if nominal else ["the nominal run"]) + [one.name for one in missing]
    text += f"to be solved: {', '.join(wanted)}"
    costs = {stage: files.out / "costs" / f"{stage}.json" for stage in (*SET_UP, "run")}
    took = {s: float(COST.read(path)["cpu_time"]) for s, path in costs.items() if path.exists()}
    by = "by the nominal run's cost"
    if solver is not None and not nominal:
        took["run"] = solver + FIXED
        by = "by the time that is predicted for the nominal run"
    if unknown := [stage for stage in costs if stage not in took]:
        return f"{text}; the nominal run's cost of {', '.join(unknown)} {PREDICT}"
    # a plane grid is made finer in two directions only
    dimensions = 2 if scene_numbers(files)["model"]["kind"] == "2d" else 3
    works = [_work(one, dimensions) for one in missing] + [(1.0, 1.0)] * (not nominal)
    time = _duration(_solving_time(took, works, ranks))
    return f"{text}, about {time} on {ranks} idle cores, {by}"


def _solved(files: StageFiles, name: str) -> bool:
    return (files.out / "inputs" / name / "out" / files.level / "run" / "run.json").exists()


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
