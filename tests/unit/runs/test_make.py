"""Making the stages of a run: what is made, taken over and refused."""

import multiprocessing
import os
import shutil
import signal
import threading
from pathlib import Path

import pytest

from pipeline.formats.kinematics import read_kinematics
from pipeline.runs.estimate import duration
from pipeline.runs.run import Run, open_run
from pipeline.runs.stages import STAGES
from pipeline.scene.scene import load_scene
from piv.files.errors import StageError
from piv.files.lock import exclusive
from piv.files.record import read_record, record_path, write_record
from softfinger.make import LOG, Machine, _expected, make, make_stage
from softfinger.sheets import make_sheet
from tests.conftest import CASES, write_scene

ONE = Machine()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a small scene whose motion and mesh are made."""
    scene = write_scene(tmp_path_factory.mktemp("made") / "scene")
    make(Run(scene), "mesh", ONE, quiet=True)
    return scene.folder


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Run:
    """A copy of that scene, with its results."""
    return Run(load_scene(shutil.copytree(made, tmp_path / "scene", symlinks=True), "tiny"))


def again(run: Run, **values) -> Run:
    """The run of the scene's folder as it is now, with overrides."""
    return open_run(run.scene.folder, "tiny", values, run.out)


def test_a_sheet_that_runs_share_has_one_writer(run: Run) -> None:
    """Recordings of one set-up share the sheet over their view."""
    path = run.out / "lab.h5"
    with exclusive(path), pytest.raises(BlockingIOError):
        make_sheet(run, (-0.1, 0.1, 0.0, 0.2), path, quiet=True)


def test_nothing_is_made_twice(run: Run) -> None:
    first = {stage: read_record(run.out, stage) for stage in ("kinematics", "mesh")}
    assert run.stale("mesh") == {}
    make(run, "mesh", ONE, quiet=True)
    assert {stage: read_record(run.out, stage) for stage in first} == first


def test_record_says_what_a_stage_cost_and_wrote(run: Run) -> None:
    record = read_record(run.out, "mesh")
    assert record is not None
    assert set(record["outputs"]) == {"planform.h5", "mesh_quality.csv"}
    assert record["outputs"]["planform.h5"]["bytes"] == run.path("mesh").stat().st_size
    assert record["made_from"]["numbers"]["mesh.wall_cell"] == run.scene.mesh.wall_cell
    assert record["wall_time"] > 0
    assert record["cpu_time"] > 0
    assert record["peak_memory"] > 1e7  # bytes: no Python with numpy takes less than 10 MB


@pytest.mark.parametrize("level, measured", [("smoke", 41), ("coarse", 212)])
def test_first_estimate_is_near_the_time_that_a_fresh_clone_took(tmp_path, level, measured):
    """Measured 2026-11-24 on two cores with two ranks, s; other machines differ by more."""
    run = open_run(CASES / "single_finger", level, {}, tmp_path)
    expected = sum(_expected(run, stage.name, Machine(2, 2)) for stage in STAGES)
    assert measured / 1.3 < expected < 1.3 * measured


def test_reason_names_the_key_and_both_values(run: Run) -> None:
    tip = run.scene.mesh.tip_cell
    changed = f"mesh.tip_cell changed from {tip} to 0.003"
    assert again(run, **{"mesh.tip_cell": 0.003}).stale("mesh") == {"mesh": changed}


def test_an_equal_stage_of_another_run_is_taken_over(run: Run, capfd) -> None:
    other = open_run(run.scene.folder, "tiny", {"fluid.density": 1000.0}, run.out.parent / "other")
    make(other, "mesh", ONE)
    assert "taken over" in capfd.readouterr().out
    assert other.path("mesh").samefile(run.path("mesh"))
    assert other.stale("mesh") == {}


def test_the_terminal_shows_the_target_and_warnings_and_the_log_has_all(tmp_path, capfd) -> None:
    """A history that begins with a jump of its slope is warned of, whatever the target."""
    (tmp_path / "p.csv").write_text("t,p\n0,0\n0.1,3000\n0.2,6000\n")
    motion = '[motion]\npressure_csv = "../p.csv"\nsmoothing = 0.0\nend_time = 0.2\n'
    run = Run(write_scene(tmp_path / "scene", more=motion))
    make(run, "mesh", ONE)
    shown = capfd.readouterr().out
    assert "mesh: planform of" in shown
    assert "kinematics: warning: " in shown
    assert "of bend in" not in shown
    log = (run.out / LOG).read_text(encoding="utf-8")
    assert "of bend in" in log
    assert "mesh: planform of" in log


def test_a_changed_file_is_refused_by_its_readers_and_made_again(run: Run) -> None:
    path = run.path("kinematics")
    whole = path.read_bytes()
    path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    with pytest.raises(StageError, match="damaged or changed"):
        read_kinematics(path)
    changed = "kinematics.h5 has changed since it was written"
    assert again(run).stale("kinematics") == {"kinematics": changed}
    make(again(run), "kinematics", ONE, quiet=True)
    read_kinematics(path)


def test_a_result_of_another_run_is_not_used(run: Run, tmp_path: Path) -> None:
    other = Run(write_scene(tmp_path / "other", more="[finger]\ntilt_deg = 5.0\n"))
    make(other, "mesh", ONE, quiet=True)
    own = {stage: run.path(stage).read_bytes() for stage in ("kinematics", "mesh")}
    shutil.copytree(other.out, run.out, dirs_exist_ok=True)
    extra = run.out / "mesh_extra.csv"  # a file that the stage itself would not write again
    extra.write_text("of the other")
    record = read_record(run.out, "mesh")
    assert record is not None
    write_record(run.out, "mesh", record, [run.path("mesh"), extra])
    assert "finger.tilt_deg changed" in again(run).stale("mesh")["kinematics"]
    make(again(run), "mesh", ONE, quiet=True)
    assert not extra.exists()
    for stage, content in own.items():
        assert run.path(stage).read_bytes() == content


def test_a_stage_itself_reads_no_result_of_another_run(run: Run, tmp_path: Path) -> None:
    """Whatever a plan found: the input that a stage finds when it starts must be its run's."""
    other = Run(write_scene(tmp_path / "other", more="[finger]\ntilt_deg = 5.0\n"))
    make(other, "kinematics", ONE, quiet=True)
    shutil.copytree(other.out, run.out, dirs_exist_ok=True)
    record_path(run.out, "mesh").unlink()
    with pytest.raises(StageError, match=r"kinematics\.h5: is not of these numbers; run make"):
        make_stage(again(run), "mesh", ONE, quiet=True)


def test_a_lost_file_is_made_again_and_a_deleted_case_is_not_needed(run: Run) -> None:
    make(run, "case", ONE, quiet=True)
    shutil.rmtree(run.out / "case")
    assert list(again(run).stale("case")) == ["case"]
    assert again(run).stale("mesh") == {}
    run.path("kinematics").unlink()
    assert again(run).stale("mesh") == {"kinematics": "kinematics.h5 is missing"}


def test_an_edited_case_is_made_again(run: Run) -> None:
    """A change by hand would be solved, and no record would show it."""
    make(run, "case", ONE, quiet=True)
    for name in ("system/fvSchemes", "constant/transportProperties", "0/U"):
        path = run.out / "case" / "interval_0" / name
        text = path.read_text()
        path.write_text(text + "// by hand\n")
        changed = f"case/interval_0/{name} has changed since it was written"
        assert again(run).stale("solve") == {"case": changed, "solve": "not made yet"}
        make(again(run), "case", ONE, quiet=True)
        assert path.read_text() == text


def test_a_stage_that_another_process_makes_is_refused(run: Run) -> None:
    stale, record = again(run, **{"mesh.tip_cell": 0.003}), read_record(run.out, "mesh")
    with exclusive(run.out / "mesh.stage"), pytest.raises(OSError, match=r"^mesh: .*writing"):
        make(stale, "mesh", ONE, quiet=True)
    assert read_record(run.out, "mesh") == record


def _spin(scene, quiet) -> None:
    """A library that never returns, and takes no signal that Python could handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while True:
        pass


def test_a_stage_without_end_is_ended_and_named(run: Run, monkeypatch) -> None:
    monkeypatch.setattr("pipeline.mesh.stage.run", _spin)
    monkeypatch.setattr("softfinger.make.cpu_limit", lambda run, stage: 1.0)
    with pytest.raises(StageError, match=r"^mesh: is not over after .* minutes of CPU time; simpl"):
        make(again(run, **{"mesh.tip_cell": 0.003}), "mesh", ONE, quiet=True)


def test_ctrl_c_ends_a_stage_that_does_not_listen(run: Run, monkeypatch) -> None:
    monkeypatch.setattr("pipeline.mesh.stage.run", _spin)
    monkeypatch.setattr("softfinger.make._TIDY", 0.2)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job's ignores Ctrl-C
    interrupt = threading.Timer(2.0, os.kill, (os.getpid(), signal.SIGINT))
    interrupt.start()
    with pytest.raises(KeyboardInterrupt):
        make(again(run, **{"mesh.tip_cell": 0.003}), "mesh", ONE, quiet=True)
    assert not multiprocessing.active_children()


def test_a_failing_stage_is_one_sentence_with_its_name(run: Run) -> None:
    bad = again(run, **{"mesh.max_non_orthogonality_deg": 1.0})
    with pytest.raises(StageError, match=r"^mesh: .*non-orthogonality"):
        make(bad, "mesh", ONE, quiet=True)
    assert read_record(run.out, "mesh") is None


def test_record_of_another_version_is_none(run: Run) -> None:
    path = record_path(run.out, "mesh")
    path.write_text(path.read_text().replace('"format_version": 1', '"format_version": 9'))
    assert again(run).stale("mesh") == {"mesh": "not made yet"}


def test_a_case_that_another_clone_has_made_is_made_again(tmp_path):
    """OpenFOAM runs what its files say, and a stranger's record can state any checksum."""
    scene = write_scene(tmp_path / "small")
    run = open_run(scene.folder, "tiny")
    make(run, "case", Machine(), quiet=True)
    assert run.why_stale("case") is None
    control = run.out / "case" / "interval_0" / "system" / "controlDict"
    control.write_text(control.read_text() + 'libs ("theirs.so");\n')
    record = read_record(run.out, "case")
    files = [run.out / name for name in record.pop("outputs")]
    write_record(run.out, "case", record, files)
    assert run.why_stale("case") == "it was not made by this clone"
    twin = open_run(scene.folder, "tiny", {"sheet.margin": 0.004}, tmp_path / "small" / "out" / "b")
    assert twin.digest("case") == run.digest("case")
    assert twin.twin("case") is None
    make(run, "case", Machine(), quiet=True)
    assert run.why_stale("case") is None
    assert "theirs" not in control.read_text()


@pytest.mark.parametrize(
    "seconds, text", [(6.2, "6 s"), (89, "89 s"), (600, "10 min"), (7200, "2.0 h")]
)
def test_times_are_in_the_unit_that_is_read(seconds, text) -> None:
    assert duration(seconds) == text
