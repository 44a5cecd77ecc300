"""A study's table: its rows, the jobs that are left, what runs share, how a run may end."""

import json
import subprocess
from pathlib import Path

import pytest

import softfinger.study.plan
import softfinger.study.table
from pipeline.runs.run import run_of
from piv.files.errors import StageError
from piv.files.record import read_record
from softfinger import __main__ as program
from softfinger.make import Machine, make
from softfinger.study.command import plot, schedule
from softfinger.study.outcome import write_outcome
from softfinger.study.plan import describe, plan_study, run_job
from softfinger.study.rows import parse_cell, read_study
from softfinger.study.table import missing_runs, study_table
from tests.conftest import CASES, ROOT, write_scene

HEADER = "run, level, until, ranks, may_fail, numerics.time_step, model.kind, camera.centre\n"
SHIPPED = sorted(CASES.glob("*/studies/*.csv"))


def table(folder: Path, rows: str) -> Path:
    (folder / "studies").mkdir(parents=True, exist_ok=True)
    path = folder / "studies" / "trial.csv"
    path.write_text("# a comment\n" + HEADER + rows, encoding="utf-8")
    return path


def planned(folder: Path, rows: str, *only: str) -> dict:
    path = plan_study(folder, "trial", read_study(table(folder, rows)), only)
    return json.loads(path.read_text()) | {"path": path}


def jobs(plan: dict) -> list[tuple[str, str]]:
    return [(job["run"], job["stage"]) for job in plan["jobs"].values()]


def test_rows_become_runs_that_differ_in_what_the_table_says(tmp_path: Path) -> None:
    scene = write_scene(tmp_path / "small")
    rows = 'fine, tiny, solve, 2, , 5e-4, , \nwide, tiny, vortices, , , , half, "[0.01, 0.2]"\n'
    fine, wide = read_study(table(scene.folder, rows))
    assert (fine.ranks, fine.until, wide.ranks, wide.until) == (2, "solve", 1, "vortices")
    runs = [run_of(describe(scene.folder, "trial", row)) for row in (fine, wide)]
    assert runs[0].scene.numerics.time_step == 5e-4
    assert (runs[1].scene.model.kind, runs[1].scene.camera.centre) == ("half", (0.01, 0.2))
    assert runs[0].scene.mesh == runs[1].scene.mesh == scene.mesh
    assert runs[0].out == scene.folder / "out" / "studies" / "trial" / "fine"


def test_equal_stages_are_computed_once(tmp_path: Path) -> None:
    scene = write_scene(tmp_path / "small")
    plan = planned(scene.folder, "a, tiny, mesh, , , , , \nb, tiny, mesh, , , , , \n")
    assert jobs(plan) == [(r, s) for r in "ab" for s in ("kinematics", "mesh")]
    mine, its = list(plan["jobs"])[1], list(plan["jobs"])[3]
    assert mine in plan["jobs"][its]["inputs"]
    for run, stage in jobs(plan):
        run_job(plan["path"], run, stage, 1)
    root = scene.folder / "out" / "studies" / "trial"
    assert (root / "a" / "planform.h5").samefile(root / "b" / "planform.h5")
    assert planned(scene.folder, "a, tiny, mesh, , , , , \n")["jobs"] == {}


def test_only_what_a_change_makes_stale_is_planned(tmp_path: Path) -> None:
    scene = write_scene(tmp_path / "small")
    plan = planned(scene.folder, "a, tiny, mesh, , , , , \n")
    for run, stage in jobs(plan):
        run_job(plan["path"], run, stage, 1)
    assert jobs(planned(scene.folder, "a, tiny, mesh, , , 5e-4, , \n")) == [("a", "mesh")]


def test_only_some_runs_are_planned_and_an_unknown_one_is_refused(tmp_path: Path) -> None:
    """A plan names all runs and the jobs of the chosen ones; it removes no record."""
    scene = write_scene(tmp_path / "small")
    rows = "a, tiny, mesh, , , , , \nb, tiny, mesh, , , , , \n"
    assert {run for run, _ in jobs(planned(scene.folder, rows, "b"))} == {"b"}
    with pytest.raises(StageError, match="no run 'c'; the runs are a, b"):
        planned(scene.folder, rows, "c")


def test_only_the_solver_is_faster_by_more_ranks(tmp_path: Path) -> None:
    """The other stages of a run that may fail take their time, more than the least of 5 minutes."""
    scene = write_scene(tmp_path / "small")
    (job,) = planned(scene.folder, "a, tiny, report, 100, yes, , , \n")["jobs"].values()
    assert job["minutes"] > 5


def test_another_actuator_is_analysed_first(tmp_path: Path) -> None:
    path = tmp_path / "s.csv"
    path.write_text("run, level, until, actuator.width\nthin, smoke, kinematics, 0.02\n")
    (row,) = read_study(path)
    run = run_of(describe(CASES / "single_finger", "s", row))
    assert list(run.stale("kinematics")) == ["fea", "kinematics"]
    states = run.scene.folder / run.scene.motion.states
    assert states.resolve() == (run.out / "states.h5").resolve()


@pytest.mark.parametrize(
    "rows, part",
    [
        ("a, tiny, solve, 0, , , , \n", "ranks = '0'"),
        ("a, tiny, dance, 1, , , , \n", "until = 'dance'"),
        ("../a, tiny, solve, 1, , , , \n", "run = '../a'"),
        ("a, tiny, solve, 1, , , , \na, tiny, solve, 1, , , , \n", "occurs twice"),
        ("", "no rows"),
        ("a, tiny, solve, 1, , , 4d, \n", "run a: "),
        ("a, tiny, solve, 1, , 3e-4, , \n", "numerics.time_step"),
        ("a, tiny, solve, 1, perhaps, , , \n", "may_fail = 'perhaps'"),
        ("a, tiny, solve, 1, no, , , , 7, 8\n", "has 10 cells, the first row 8"),
    ],
)
def test_a_bad_table_ends_with_one_sentence(tmp_path: Path, rows: str, part: str) -> None:
    scene = write_scene(tmp_path / "small")
    with pytest.raises(StageError) as error:
        planned(scene.folder, rows)
    assert part in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text, words",
    [
        ("run, fluid.density, fluid.density\na, 1000, 900\n", r"'fluid\.density' occurs twice"),
        ("run, level, colour\na, tiny, red\n", "'colour'"),
    ],
)
def test_double_and_unknown_columns_are_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "s.csv").write_text(text)
    with pytest.raises(StageError, match=words):
        read_study(tmp_path / "s.csv")


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: f"{path.parents[1].name}-{path.stem}")
def test_every_row_of_a_shipped_study_is_a_run(path: Path) -> None:
    """A slip in a table is found here, not after the runs before it; some rows may be refused."""
    for row in read_study(path):
        try:
            run_of(describe(path.parents[1], path.stem, row))
        except StageError:
            assert row.may_fail, row.run


@pytest.mark.parametrize(
    "key, value, ended, stage",
    [
        ("numerics.time_step", 0.001, "completed", "mesh"),
        ("finger.length", -1.0, "refused", "scene"),
        ("mesh.max_non_orthogonality_deg", 1.0, "refused", "mesh"),
    ],
)
def test_how_a_run_ends_is_a_result(tmp_path: Path, key, value, ended, stage) -> None:
    scene = write_scene(tmp_path / "small")
    out = tmp_path / "place"
    about = {"folder": str(scene.folder), "level": "tiny", "overrides": {key: value},
             "out": str(out), "until": "mesh", "ranks": 1, "compared_ranks": None}  # fmt: skip
    write_outcome(about, Machine())
    record = read_record(out, "outcome")
    assert record is not None
    assert (record["ended"], record["ended_at"]) == (ended, stage)
    assert bool(record["reason"]) == (ended != "completed")


def test_a_stage_that_hangs_is_ended(tmp_path: Path) -> None:
    (row,) = read_study(table(tmp_path, "a, coarse, mesh, 1, , , , \n"))
    run = run_of(describe(CASES / "single_finger", "s", row))
    with pytest.raises(StageError, match="is not over after"):
        make(run, "mesh", Machine(), quiet=True, longest=0.01)


def _endless(scene, quiet) -> None:
    while True:
        pass


def test_a_job_of_snakemake_without_end_is_ended(tmp_path: Path, monkeypatch) -> None:
    scene = write_scene(tmp_path / "small")
    plan = planned(scene.folder, "a, tiny, kinematics, , , , , \n")
    monkeypatch.setattr("pipeline.kinematics.stage.run", _endless)
    monkeypatch.setattr("softfinger.make.cpu_limit", lambda run, stage: 1.0)
    with pytest.raises(StageError, match=r"^kinematics: is not over after .* minutes of CPU time"):
        run_job(plan["path"], "a", "kinematics", 1)


def test_a_study_without_openfoam_is_refused_before_anything_runs(tmp_path, monkeypatch) -> None:
    scene = write_scene(tmp_path / "small")
    plan = planned(scene.folder, "a, tiny, solve, 2, , , , \n")

    def missing(ranks: int) -> None:
        raise StageError(f"no OpenFOAM for {ranks} ranks")

    monkeypatch.setattr("softfinger.study.plan.check_openfoam", missing)
    monkeypatch.setattr("subprocess.run", lambda *_, **__: pytest.fail("something runs"))
    with pytest.raises(StageError, match="no OpenFOAM for 2 ranks"):
        schedule(plan["path"], slurm=False)


def test_values_of_make_are_not_those_of_its_jobs(tmp_path, monkeypatch) -> None:
    """`make study NP=1`: every job said that it does not use NP."""
    scene, ran = write_scene(tmp_path / "small"), []
    plan = planned(scene.folder, "a, tiny, kinematics, , , , , \n")
    monkeypatch.setenv("TYPED", "NP")
    done = subprocess.CompletedProcess([], 0)
    monkeypatch.setattr("subprocess.run", lambda words, **more: ran.append(more["env"]) or done)
    assert schedule(plan["path"], slurm=False) == 0
    assert ran
    assert all("TYPED" not in environment for environment in ran)


def test_snakemakes_settings_lie_where_it_looks_for_them() -> None:
    """Beside the Snakefile; elsewhere they are ignored, and a study that was killed stops."""
    assert (ROOT / "softfinger" / "study" / "profiles" / "default" / "config.yaml").exists()


def test_a_batch_job_that_fails_is_a_failure_of_the_program(monkeypatch) -> None:
    monkeypatch.setattr(program, "schedule", lambda *_: 3)
    with pytest.raises(SystemExit) as end:
        program.main(["run", str(CASES / "single_finger"), "--slurm", "--level", "smoke"])
    assert end.value.code == 3


def test_a_value_is_written_as_in_json_or_as_in_the_scene() -> None:
    stroke = [{"pressure_kpa": 20.0, "start": 0.1}]
    assert parse_cell('[{"pressure_kpa": 20.0, "start": 0.1}]') == stroke
    assert parse_cell("[{ pressure_kpa = 20.0, start = 0.1 }]") == stroke
    assert (parse_cell("1e-3"), parse_cell("LUST"), parse_cell("true")) == (1e-3, "LUST", True)


@pytest.mark.parametrize("name", ["a b", "a$(touch made)b", "o'brien", "a{b}"])
def test_a_folder_whose_name_a_shell_or_snakemake_would_read_is_refused(tmp_path, name) -> None:
    scene = write_scene(tmp_path / name)
    with pytest.raises(StageError, match=r"jobs need paths of letters.*rename the folder"):
        planned(scene.folder, "a, tiny, mesh, 1, , , , \n")


def test_one_run_of_a_long_study_reads_the_scene_of_no_other(tmp_path, monkeypatch) -> None:
    """A table of 10,000 rows was not planned and tabulated in 85 s."""
    scene, read = write_scene(tmp_path / "small"), []
    opened = softfinger.study.table.run_of
    for module in (softfinger.study.plan, softfinger.study.table):
        monkeypatch.setattr(module, "run_of", lambda row: read.append(row["run"]) or opened(row))
    rows = "".join(f"r{k}, tiny, mesh, 1, , 5e-4, , \n" for k in range(500))
    plan = planned(scene.folder, rows, "r5")
    assert read == ["r5"]
    table = study_table(plan, missing_runs(plan))
    assert read == ["r5"]
    assert list(table["missing"]) == ["not made yet"] * 500


def test_a_column_over_another_is_drawn_or_what_is_missing_is_named(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("run,level,mesh.tip_cell,peak_force_N\na,draft,1,2\nb,draft,2,3\nc,smoke,3,\n")
    plot(path, "mesh.tip_cell", "peak_force_N", output=tmp_path / "out.pdf")
    assert (tmp_path / "out.pdf").read_bytes().startswith(b"%PDF")
    with pytest.raises(StageError, match=r"no column peak_force\b.*did you mean peak_force_N"):
        plot(path, "mesh.tip_cell", "peak_force", output=tmp_path / "out.pdf")
    with pytest.raises(StageError, match=r"line 2, column level: 'draft' is not a finite number"):
        plot(path, "level", "peak_force_N", output=tmp_path / "out.pdf")
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(StageError, match="no column run in its header"):
        plot(tmp_path / "other.csv", "a", "b", output=tmp_path / "out.pdf")
    with pytest.raises(StageError, match=r"out\.doc: give a name that ends in \.png"):
        plot(path, "mesh.tip_cell", "peak_force_N", output=tmp_path / "out.doc")
