"""What a comparison says before anything is solved: which runs, and for how long."""

import pytest

from fileio.record import write_record
from pipeline.runs.run import open_run
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.lab.data.inputs_toml import Inputs, Numerics, input_rows
from postprocess.lab.data.plan import SET_UP, plan_text
from tests.conftest import write_scene

GRID = Numerics(name="grid", ratio=1.5, order=2.0, safety=3.0)
STEP = Numerics(name="time_step", ratio=2.0, order=2.0, safety=3.0)
INPUTS = Inputs(format="inputs", format_version=1, too_uncertain=0.3, numerics=(GRID, STEP))


def runs(folder, kind="2d"):
    """A nominal run and those beside it, none of them made."""
    scene = write_scene(folder / "finger", kind)
    rows = input_rows(scene_numbers(StageFiles(scene)), INPUTS)
    beside = {n: open_run(scene.folder, "tiny", o, scene.out / "inputs" / n) for n, o in rows}
    return open_run(scene.folder, "tiny"), beside


def made(run, stage="run", seconds=0.0):
    about = {"digest": run.digest(stage), "cpu_time": seconds, "peak_memory": 0}
    write_record(run.out, stage, about, [])


@pytest.mark.parametrize("kind, dimensions", [("2d", 2), ("half", 3)])
def test_the_nominal_run_tells_the_time_of_the_others(tmp_path, kind, dimensions):
    """250 CPU s on two ranks, of which 10 are the same for all runs; the mesh takes 24 s."""
    run, beside = runs(tmp_path, kind)
    made(run, seconds=250.0)
    for stage in SET_UP:
        made(run, stage, 24.0 if stage == "mesh" else 0.0)
    cells = 1.5 ** (dimensions - 0.5)
    minutes = 2 * (cells + 2) + 2 * 5 / 60 + 0.4 * (cells + 1)  # one process makes the mesh
    text = plan_text(run, beside, INPUTS, ranks=2)
    assert text == (
        "plan: solved already: the nominal run; to be solved: grid, time_step, about"
        f" {minutes:.0f} min on 2 idle cores, by the nominal run's cost"
    )
    for one in beside.values():
        made(one)
    text = plan_text(run, beside, INPUTS, ranks=2)
    assert text == (
        "plan: solved already: the nominal run, grid, time_step; nothing is left to solve"
    )


def test_without_the_nominal_run_the_time_is_predicted(tmp_path):
    text = plan_text(*runs(tmp_path), INPUTS, ranks=2)
    assert "solved already: nothing; to be solved: the nominal run, grid, time_step" in text
    assert "on 2 idle cores, by the time predicted for the nominal run" in text
