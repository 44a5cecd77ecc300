"""Whatever a folder from others holds, a run touches no file outside of its own folder."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.runs.run import Run, open_run
from piv.files.errors import StageError
from piv.files.record import check_own, forget, read_record, record_path
from postprocess.lab.inputs import read_inputs
from softfinger.make import Machine, make
from tests.conftest import write_scene

ONE = Machine()


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run whose motion is made."""
    made = Run(write_scene(tmp_path_factory.mktemp("made") / "scene"))
    make(made, "kinematics", ONE, quiet=True)
    return made.out


@pytest.fixture
def run(tmp_path: Path, results: Path) -> Run:
    """A copy of it, and a user's file beside the scene."""
    scene = write_scene(tmp_path / "scene")
    shutil.copytree(results, scene.out)
    (tmp_path / "mine.txt").write_text("mine")
    return Run(scene)


def edit(run: Run, **values) -> None:
    """Replace values of the record of the kinematics."""
    path = record_path(run.out, "kinematics")
    path.write_text(json.dumps(json.loads(path.read_text()) | values))


def with_output(run: Run, name: str) -> None:
    """Name one more file in the record, as if the stage had written it."""
    record = json.loads(record_path(run.out, "kinematics").read_text())
    path = run.out / name
    state = {"bytes": path.stat().st_size, "time_ns": path.stat().st_mtime_ns, "sha256": "0" * 64}
    edit(run, outputs=record["outputs"] | {name: state})


@pytest.mark.parametrize("place", ["absolute", "above", "link"])
def test_a_record_deletes_no_file_of_others(run: Run, tmp_path: Path, place: str) -> None:
    mine = tmp_path / "mine.txt"
    names = {"absolute": str(mine), "above": os.path.relpath(mine, run.out), "link": "l/mine.txt"}
    (run.out / "l").symlink_to(tmp_path)
    with_output(run, names[place])
    assert read_record(run.out, "kinematics") is None
    forget(run.out, "kinematics", "another")
    assert mine.read_text() == "mine"
    (run.out / "l").unlink()
    make(open_run(run.scene.folder, "tiny", {"motion.end_time": 0.1}, run.out), "kinematics", ONE)
    assert mine.read_text() == "mine"


def test_taking_over_writes_no_file_of_others(run: Run, tmp_path: Path) -> None:
    """A stranger's folder holds, three levels above its results, what should replace mine."""
    theirs = run.out.with_name("theirs")
    run.out.rename(theirs)
    with_output(
        replace(run, scene=run.scene.model_copy(update={"out": theirs})), "../../../mine.txt"
    )
    other = open_run(run.scene.folder, "tiny", {}, run.scene.folder / "out" / "variations" / "b")
    above = other.out / "../../../mine.txt"
    make(other, "kinematics", ONE, quiet=True)
    assert not above.exists()


@pytest.mark.parametrize(
    "values",
    [
        {"outputs": {"kinematics.h5": []}}, {"outputs": {"kinematics.h5": {"sha256": 3}}},
        {"outputs": {"": {"sha256": ""}}}, {"outputs": {"a\0b": {"sha256": ""}}},
        {"outputs": {".": {"sha256": ""}}}, {"digest": None}, {"made_from": []},
        {"made_from": {"numbers": 3}}, {"cpu_time": "much"}, {"peak_memory": 10**400},
        {"stage": 7}, {"cpu_time": float("nan")},
    ],
)  # fmt: skip
def test_a_record_of_a_wrong_shape_is_as_if_it_were_not_there(run: Run, values) -> None:
    edit(run, **values)
    assert read_record(run.out, "kinematics") is None
    assert run.why_stale("kinematics") == "not made yet"
    make(run, "kinematics", ONE, quiet=True)
    assert read_record(run.out, "kinematics") is not None


def test_a_record_that_never_ends_is_as_if_it_were_not_there(run: Run) -> None:
    path = record_path(run.out, "kinematics")
    path.unlink()
    path.symlink_to("/dev/zero")
    assert read_record(run.out, "kinematics") is None


@pytest.mark.parametrize("name", ["log.txt", "case", "run/history.csv", "made"])
def test_a_link_that_leads_out_is_refused_before_anything_is_written(
    tmp_path: Path, name: str
) -> None:
    run, mine = Run(write_scene(tmp_path / "scene")), tmp_path / "mine"
    mine.mkdir()
    (mine / "a").write_text("mine")
    link = run.out / name
    link.parent.mkdir(parents=True)
    link.symlink_to(mine if name in ("case", "made") else mine / "a")
    with pytest.raises(StageError, match=f"{name}: leads out of .*; remove this link$"):
        make(run, "case", ONE, quiet=True)
    assert [path.read_text() for path in mine.iterdir()] == ["mine"]


@pytest.mark.parametrize("target", ["../mine", "nowhere"])
def test_a_folder_of_results_that_is_a_link_out_or_dangling_is_refused(
    tmp_path: Path, target: str
) -> None:
    run = Run(write_scene(tmp_path / "scene"))
    (tmp_path / "mine").mkdir()
    (run.scene.folder / "out").symlink_to(target)
    with pytest.raises(StageError, match=r"scene/out.*: leads out of .*scene, or nowhere"):
        make(run, "kinematics", ONE, quiet=True)
    assert not list((tmp_path / "mine").iterdir())


def test_a_level_or_an_input_whose_name_leads_out_is_refused(tmp_path: Path) -> None:
    run = Run(write_scene(tmp_path / "scene"))
    away = Run(run.scene.model_copy(update={"out": run.scene.folder / "out" / "../../away"}))
    with pytest.raises(StageError, match="away: leads out of"):
        make(away, "kinematics", ONE, quiet=True)
    (run.scene.folder / "reference").mkdir()
    (run.scene.folder / "reference" / "inputs.toml").write_text(
        'format = "inputs"\nformat_version = 2\n[[input]]\nname = "../../away"\n'
        'key = "fluid.density"\nstep = 1.0\nlimit = 1.0\nreason = "x"\n'
    )
    with pytest.raises(StageError, match=r"inputs.toml: input\[0\].name: "):
        read_inputs(run.scene.folder)


def test_links_within_a_run_are_followed_and_a_pipe_is_refused(run: Run) -> None:
    (run.out / "again.h5").symlink_to("kinematics.h5")
    check_own(run.out)
    gate = run.out / "case" / "interval_0" / "postProcessing" / "gate" / "0.1" / "gate.vtk"
    gate.parent.mkdir(parents=True)
    os.mkfifo(gate)  # as a killed coupled run leaves it, which then goes on
    check_own(run.out)
    os.mkfifo(run.out / "pipe")
    with pytest.raises(StageError, match="pipe: is neither a file nor a folder; remove it"):
        check_own(run.out)
