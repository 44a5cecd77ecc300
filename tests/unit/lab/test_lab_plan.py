"""What a comparison says before anything is solved: which runs, and for how long."""

from fileio.record import write_record
from pipeline.runs.run import open_run
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.lab.data.inputs_toml import Inputs, Numerics, input_rows
from postprocess.lab.data.plan import STAGES, plan_text
from tests.conftest import write_scene

GRID = Numerics(name="grid", ratio=1.5, order=2.0, safety=3.0)
INPUTS = Inputs(format="inputs", format_version=1, too_uncertain=0.3, numerics=(GRID,))


def test_solved_runs_are_told_from_missing_ones(tmp_path):
    scene = write_scene(tmp_path / "finger")
    rows = input_rows(scene_numbers(StageFiles(scene)), INPUTS)
    runs = {"the nominal run": open_run(scene.folder, "tiny")}
    runs |= {n: open_run(scene.folder, "tiny", o, scene.out / "inputs" / n) for n, o in rows}
    text = plan_text(runs, ranks=2)
    assert "solved already: nothing; to be solved: the nominal run, grid, about" in text
    assert text.endswith("on 2 idle cores")
    for run in runs.values():
        for stage in STAGES:
            about = {"digest": run.digest(stage), "cpu_time": 1.0, "peak_memory": 0}
            write_record(run.out, stage, about, [])
    assert plan_text(runs, 2).endswith("the nominal run, grid; nothing is left to solve")
