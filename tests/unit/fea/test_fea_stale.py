"""A scene whose actuator has changed since the analysis of its bending states is refused."""

import shutil

import pytest

from pipeline.fea.up_to_date import check_states
from pipeline.runs.run import Run, open_run
from pipeline.scene.scene import load_scene
from piv.files.errors import StageError
from tests.conftest import CASES, write_scene

WIDER = "[actuator]\nwidth = 0.03"
OWN = '\n[motion]\nstates = "kinematics/states.h5"'  # beside the scene, not the parent's


@pytest.mark.parametrize(
    "more, words",
    [
        (WIDER, ["actuator.width = 0.03", "analysed with 0.028"]),
        ("[actuator.materials.lower.parameters]\nC10 = 9e4", ["lower.parameters.C10 = 90000"]),
        ("[fea]\nlast_pressure_kpa = 50.0", ["fea.last_pressure_kpa = 50", "with 40"]),
        ("[fea.mesh]\nspan = 5", ["fea.mesh.span = 5", "with 3"]),
    ],
)
def test_what_the_states_follow_from_is_refused_with_key_and_remedy_and_nothing_is_written(
    tmp_path, more, words
):
    scene = write_scene(tmp_path / "scene", more=more)
    with pytest.raises(StageError) as caught:
        Run(scene).check("kinematics")
    for word in (*words, "scene.toml", "states.h5", "softfinger fea", "take the change back"):
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not scene.out.exists()


@pytest.mark.parametrize(
    "more",
    [
        "",
        "[fea]\nuncertainty = false",
        '[actuator.materials.lower]\nname = "the same, of another batch"',
        WIDER + '\n[motion]\nsource = "paper_equations"',
    ],
)
def test_what_the_states_do_not_follow_from_is_left_alone(tmp_path, more):
    check_states(write_scene(tmp_path / "scene", more=more))


def test_states_without_provenance_or_not_there_are_left_to_the_stage_that_reads_them(tmp_path):
    scene = write_scene(tmp_path / "scene", more=WIDER + OWN)
    (scene.folder / "kinematics").unlink()
    check_states(scene)
    (scene.folder / "kinematics").mkdir()
    (scene.folder / "kinematics" / "states.h5").write_text("no HDF5")
    check_states(scene)


def test_the_remedy_is_of_the_scene_whose_actuator_it_is(tmp_path):
    """A child without an actuator of its own is sent to its parent's analysis."""
    parent = write_scene(tmp_path / "parent", more=WIDER + OWN)
    (parent.folder / "kinematics").unlink()
    shutil.copytree(CASES / "single_finger" / "kinematics", parent.folder / "kinematics")
    own = "[actuator]\nwidth = 0.02\n"
    for name, more, folder in (("child", "", "parent"), ("other", own, "other")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "scene.toml").write_text(f'extends = "../parent"\n{more}')
        with pytest.raises(StageError, match=f"softfinger fea {tmp_path / folder}[ ,]"):
            check_states(load_scene(tmp_path / name, "tiny"))


def test_a_run_with_another_actuator_is_not_refused(tmp_path):
    scene = write_scene(tmp_path / "small", more=WIDER)
    narrow = open_run(scene.folder, "tiny", {"actuator.width": 0.02}, tmp_path / "narrow")
    narrow.check("kinematics")
    with pytest.raises(StageError, match=r"actuator\.width"):
        open_run(scene.folder, "tiny").check("kinematics")
