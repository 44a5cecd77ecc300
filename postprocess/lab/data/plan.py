"""What a comparison has to solve, and how long that will take, before anything is solved."""

from __future__ import annotations

from pathlib import Path

from fileio.formats.records import COST
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.lab.data.inputs_toml import Input, Inputs, Numerics, run_folder

SET_UP = ("kinematics", "mesh", "case")  # stages before the solver
FIXED = 10.0  # CPU s of a run that neither cells nor steps change: programs that start, shapes, files (half of a run at most)
COUPLED = 3.0  # cost of a coupled motion's runs over that of the prescribed one (1.7 to 2.9, docs/coupling.md)
GRADED = 0.5  # of a dimension: a grid finer by r has r^(d - 0.5) times the cells (1.8 at smoke, 2.5 to 2.9 from draft to medium)


def work(one: Input | Numerics, dimensions: int) -> tuple[float, float]:
    """Cells and steps of a run beside the nominal one over the nominal run's."""
    if isinstance(one, Input):
        return 1.0, 1.0
    return (one.ratio ** (dimensions - GRADED), 1.0) if one.name == "grid" else (1.0, one.ratio)


def solving_time(took: dict[str, float], works: list[tuple[float, float]], ranks: int) -> float:
    """Time (s) of runs of so many cells and steps (of the nominal run's) on idle cores, by what its stages take (CPU s).

    Before the solver one process works, whatever the ranks.
    """
    fixed = min(FIXED, 0.5 * took["run"])
    time = 0.0
    for cells, steps in works:
        time += took["kinematics"] + took["case"] + took["mesh"] * cells
        time += (fixed + (took["run"] - fixed) * cells * steps) / ranks
    return time


def _took(files: StageFiles) -> dict[str, float]:
    """CPU time (s) of the nominal run's stages up to the solver, of those that have left it."""
    costs = {stage: files.out / "costs" / f"{stage}.json" for stage in (*SET_UP, "run")}
    return {
        stage: float(COST.read(path)["cpu_time"]) for stage, path in costs.items() if path.exists()
    }


def coupled_plan_text(files: StageFiles, home: Path, ranks: int) -> str:
    """What make compare-coupled has to solve, with its time where the nominal run has left its cost; `home`: of the coupled runs."""
    made = sorted(path.parents[2].name for path in home.glob(f"{files.level}_*/out/*/loads.h5"))
    text = f"plan: coupled runs until the motion changes no more (two to four, docs/coupling.md); there already: {', '.join(made) or 'none'}"
    took = _took(files)
    if len(took) <= len(SET_UP):
        return f"{text}; all together about three times the nominal run, whose cost is not known yet (make predict says what to expect)"
    time = COUPLED * (sum(took[stage] for stage in SET_UP) + took["run"] / ranks)
    return f"{text}; from the first on about {_duration(time)} on {ranks} idle cores, by the nominal run's cost"


def plan_text(files: StageFiles, inputs: Inputs, ranks: int, solver: float | None = None) -> str:
    """The runs that are there and those to be made, with their time by the nominal run's cost; `solver`: what its solver is predicted
    to take on one rank (s), until it is there.

    It is shared by the comparisons of a scene at a level: what one has solved the next one finds.
    """
    made = {one.name: _run(files, one.name).exists() for one in inputs.all}
    missing = [one for one in inputs.all if not made[one.name]]
    nominal = (files.out / "run" / "run.json").exists()
    there = [
        *(["the nominal run"] if nominal else []),
        *(name for name, ready in made.items() if ready),
    ]
    text = f"plan: solved already: {', '.join(there) or 'nothing'}; "
    if not missing and nominal:
        return f"{text}nothing is left to solve"
    wanted = ([] if nominal else ["the nominal run"]) + [one.name for one in missing]
    text += f"to be solved: {', '.join(wanted)}"
    took, by = _took(files), "by the nominal run's cost"
    if solver is not None and not nominal:
        took, by = (
            took | {"run": solver + FIXED},
            "by the time that is predicted for the nominal run",
        )
    unknown = [stage for stage in (*SET_UP, "run") if stage not in took]
    if unknown:
        return f"{text}; the nominal run's cost of {', '.join(unknown)} is not known yet (make predict says what to expect)"
    works = [work(one, 2 if _flat(files) else 3) for one in missing] + (
        [] if nominal else [(1.0, 1.0)]
    )
    return (
        f"{text}, about {_duration(solving_time(took, works, ranks))} on {ranks} idle cores, {by}"
    )


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
