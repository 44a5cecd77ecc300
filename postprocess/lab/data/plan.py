"""What a comparison has to solve, and how long that will take, before anything is solved."""

from __future__ import annotations

from pathlib import Path

from fileio.formats.records import COST
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.lab.data.inputs_toml import Input, Inputs, Numerics, run_folder

SET_UP = ("kinematics", "mesh", "case")  # stages before the solver
FIXED = 10.0  # CPU s of a run that neither cells nor steps change: programs that start, shapes, files (half of a run at most)
COUPLED = (
    3.0  # cost of a coupled motion's runs over that of the prescribed one (1.7 to 2.9, docs/coupling.md)
)
GRADED = 0.5  # of a dimension: a grid finer by r has r^(d - 0.5) times the cells (1.8 at smoke, 2.5 to 2.9 from draft to medium)


def work(one: Input | Numerics, dimensions: int) -> tuple[float, float]:
    """Cells and steps of a run beside the nominal one over the nominal run's."""
    if isinstance(one, Input):
        return 1.0, 1.0
    return (one.ratio ** (dimensions - GRADED), 1.0) if one.name == "grid" else (1.0, one.ratio)


def solving_time(files: StageFiles, runs: list[Input | Numerics], ranks: int) -> float:
    """Time (s) of some runs on idle cores by what the nominal one's stages took.

    Before the solver one process works, whatever the ranks.
    """
    dimensions, took = 2 if _flat(files) else 3, _took(files)
    fixed = min(FIXED, 0.5 * took["run"])
    time = 0.0
    for one in runs:
        cells, steps = work(one, dimensions)
        time += took["kinematics"] + took["case"] + took["mesh"] * cells
        time += (fixed + (took["run"] - fixed) * cells * steps) / ranks
    return time


def _took(files: StageFiles) -> dict[str, float]:
    """CPU time (s) of each of the nominal run's stages up to the solver."""
    return {stage: float(COST.read(_cost(files, stage))["cpu_time"]) for stage in (*SET_UP, "run")}


def coupled_plan_text(files: StageFiles, home: Path, ranks: int) -> str:
    """What make compare-coupled has to solve, with its time where the nominal run has left its cost; `home`: of the coupled runs."""
    made = sorted(path.parents[2].name for path in home.glob(f"{files.level}_*/out/*/loads.h5"))
    text = f"plan: coupled runs until the motion changes no more (two to four, docs/coupling.md); there already: {', '.join(made) or 'none'}"
    unknown = [stage for stage in (*SET_UP, "run") if not _cost(files, stage).exists()]
    if unknown:
        return f"{text}; all together about three times the nominal run, whose cost is not known yet (make predict says what to expect)"
    took = _took(files)
    time = COUPLED * (sum(took[stage] for stage in SET_UP) + took["run"] / ranks)
    return (
        f"{text}; from the first on about {_duration(time)} on {ranks} idle cores, by the nominal run's cost"
    )


def _cost(files: StageFiles, stage: str) -> Path:
    return files.out / "costs" / f"{stage}.json"


def plan_text(files: StageFiles, inputs: Inputs, ranks: int) -> str:
    """The runs that are there and those to be made, with their time where the nominal run has left its cost.

    It is shared by the comparisons of a scene at a level: what one has solved the next one finds.
    """
    made = {one.name: _run(files, one.name).exists() for one in inputs.all}
    missing = [one for one in inputs.all if not made[one.name]]
    nominal = (files.out / "run" / "run.json").exists()
    there = [*(["the nominal run"] if nominal else []), *(name for name, ready in made.items() if ready)]
    text = f"plan: solved already: {', '.join(there) or 'nothing'}; "
    if not missing and nominal:
        return f"{text}nothing is left to solve"
    wanted = ([] if nominal else ["the nominal run"]) + [one.name for one in missing]
    text += f"to be solved: {', '.join(wanted)}"
    unknown = [stage for stage in (*SET_UP, "run") if not _cost(files, stage).exists()]
    if not nominal or unknown:
        what = f" of {', '.join(unknown)}" if nominal else ""
        return f"{text}; the nominal run's cost{what} is not known yet (make predict says what to expect)"
    return f"{text}, about {_duration(solving_time(files, missing, ranks))} on {ranks} idle cores, by the nominal run's cost"


def _run(files: StageFiles, name: str) -> Path:
    return run_folder(files, name) / "out" / files.level / "run" / "run.json"


def _flat(files: StageFiles) -> bool:
    """Whether the level is of two dimensions: its grid is made finer in two directions only."""
    return bool(scene_numbers(files)["model"]["kind"] == "2d")


def _duration(seconds: float) -> str:
    return (
        f"{seconds:.0f} s"
        if seconds < 90
        else f"{seconds / 60:.0f} min"
        if seconds < 5400
        else f"{seconds / 3600:.1f} h"
    )
