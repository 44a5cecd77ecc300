"""What a comparison says before anything is solved: which runs, and for how long."""

import pytest

from fileio.formats.records import COST
from postprocess.evidence.stage_files import StageFiles
from postprocess.lab.data import plan
from postprocess.lab.data.inputs_toml import Input, Inputs, Numerics

PRESSURE = Input(name="pressure", key="motion.pressure", step=0.4, limit=0.2, reason="the sensor")
GRID = Numerics(name="grid", ratio=1.5, order=2.0, safety=3.0)
STEP = Numerics(name="time_step", ratio=2.0, order=2.0, safety=3.0)
INPUTS = Inputs(
    format="inputs", format_version=1, too_uncertain=0.3, input=(PRESSURE,), numerics=(GRID, STEP)
)


def solved(files: StageFiles, *names: str) -> None:
    """Runs that are there; "" is the nominal one."""
    for name in names:
        path = (
            files.out / "run" if not name else files.out / "inputs" / name / "out" / "smoke" / "run"
        )
        path.mkdir(parents=True)
        (path / "run.json").write_text("{}")


def test_without_the_nominal_run_all_runs_are_named(tmp_path):
    told = plan.plan_text(StageFiles(tmp_path / "finger", "smoke"), INPUTS, 2)
    assert (
        "solved already: nothing; to be solved: the nominal run, pressure, grid, time_step" in told
    )
    assert "make predict" in told


@pytest.mark.parametrize("kind, minutes", [("2d", 1 + 1.5**1.5 + 2), ("half", 1 + 1.5**2.5 + 2)])
def test_the_nominal_run_tells_the_time_of_the_others(tmp_path, monkeypatch, kind, minutes):
    """250 CPU s on two ranks, of which 10 are the same for all runs; the mesh takes a tenth."""
    files = StageFiles(tmp_path / "finger", "smoke")
    solved(files, "")
    COST.write(files.out / "costs" / "run.json", {"stage": "run", "cpu_time": 250.0})
    monkeypatch.setattr(plan, "scene_numbers", lambda files: {"model": {"kind": kind}})
    assert f"cost of {', '.join(plan.SET_UP)} is not known yet" in plan.plan_text(files, INPUTS, 2)
    for stage in plan.SET_UP:
        took = 24.0 if stage == "mesh" else 0.0
        COST.write(files.out / "costs" / f"{stage}.json", {"stage": stage, "cpu_time": took})
    cells = 1.5**1.5 if kind == "2d" else 1.5**2.5
    minutes = 2 * minutes + 3 * 5 / 60 + 0.4 * (1 + cells + 1)  # one process makes the mesh
    told = plan.plan_text(files, INPUTS, 2, solver=1e6)
    assert f"about {minutes:.0f} min on 2 idle cores, by the nominal run's cost" in told


def test_the_time_is_said_before_the_nominal_run_by_what_its_solver_is_predicted_to_take(
    tmp_path, monkeypatch
):
    """250 CPU s, of which 10 are the same for all: two ranks, four runs, three of one grid."""
    files = StageFiles(tmp_path / "finger", "smoke")
    monkeypatch.setattr(plan, "scene_numbers", lambda files: {"model": {"kind": "2d"}})
    for stage in plan.SET_UP:
        COST.write(files.out / "costs" / f"{stage}.json", {"stage": stage, "cpu_time": 0.0})
    assert "cost of run is not known yet" in plan.plan_text(files, INPUTS, 2)
    minutes = 2 * (1 + 1 + 1.5**1.5 + 2) + 4 * 5 / 60
    told = plan.plan_text(files, INPUTS, 2, solver=250.0)
    assert f"about {minutes:.0f} min on 2 idle cores, by the time that is predicted" in told


def test_runs_of_an_earlier_comparison_are_shared(tmp_path):
    files = StageFiles(tmp_path / "finger", "smoke")
    solved(files, "", "pressure", "grid", "time_step")
    told = plan.plan_text(files, INPUTS, 2)
    assert told.endswith(
        "solved already: the nominal run, pressure, grid, time_step; nothing is left to solve"
    )
