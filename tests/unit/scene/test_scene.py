"""Scenes as they are shipped, inherited and resolved; which stages a key makes again."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from pipeline.formats.bending_states import States, read_states
from pipeline.kinematics.stage import kinematics_values
from pipeline.scene.scene import load_scene
from pipeline.scene.sections import Numerics
from piv.files.errors import StageError
from tests.conftest import CASES, ROOT, write_scene

SCENES = sorted(p.parent for p in CASES.glob("*/scene.toml"))


@pytest.mark.parametrize("folder", SCENES, ids=lambda p: p.name)
@pytest.mark.parametrize("level", ["smoke", "draft", "coarse", "medium", "fine", "reference"])
def test_every_shipped_scene_is_valid_at_every_level(folder, level):
    scene = load_scene(folder, level)
    assert scene.level == level
    assert scene.notes == ()  # no reader of a shipped scene is told what to mend
    assert scene.motion.states is None or (scene.folder / scene.motion.states).is_file()


@pytest.mark.parametrize("folder", SCENES, ids=lambda p: p.name)
def test_the_levels_that_are_refined_together_share_one_convection_scheme(folder):
    levels = ["draft", "coarse", "medium", "fine", "reference"]
    assert len({load_scene(folder, level).numerics.convection for level in levels}) == 1


def test_a_finger_near_the_bottom_is_warned_of_and_one_that_hits_it_refused(tmp_path):
    assert write_scene(tmp_path / "as_shipped").remarks() == []
    scene = write_scene(tmp_path / "near", more="[finger]\nroot = [0.0, 0.16]")
    assert "0.1 m" in scene.remarks()[0]
    kinematics_values(scene)
    with pytest.raises(StageError, match=r"hits the bottom at .* raise finger.root"):
        kinematics_values(write_scene(tmp_path / "deep", more="[finger]\nroot = [0.0, 0.065]"))


def test_lengths_that_are_not_given_go_with_the_size_of_the_finger(tmp_path):
    more = "[finger]\nlength = 0.14\n[mesh]\ntip_transition = 0.03"
    for text, lengths in (("", (0.012, 0.02, 0.002)), (more, (0.024, 0.03, 0.004))):
        mesh = write_scene(tmp_path / "s", more=text).mesh
        assert (mesh.tip_distance, mesh.tip_transition, mesh.wall_distance) == lengths


def test_missing_scene_and_level_name_what_there_is(tmp_path):
    with pytest.raises(StageError, match="no such scene"):
        load_scene(tmp_path / "nowhere")
    with pytest.raises(StageError, match="coarse, draft, fine, medium, reference, smoke"):
        load_scene(CASES / "single_finger", "huge")
    with pytest.raises(StageError, match=r"no level .smok.; did you mean smoke[?]"):
        load_scene(CASES / "single_finger", "smok")
    (tmp_path / "scene.toml").write_text(f"extends = '{ROOT}/cases/single_fingr'\n")
    with pytest.raises(StageError, match=r"extends = .*: no .*; did you mean single_finger[?]"):
        load_scene(tmp_path)


def test_a_scene_cannot_extend_itself(tmp_path):
    for name, other in (("a", "b"), ("b", "a")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "scene.toml").write_text(f'extends = "../{other}"\n')
    with pytest.raises(StageError, match="break the circle"):
        load_scene(tmp_path / "a")
    (tmp_path / "a" / "scene.toml").write_text("extends = 1\n")
    with pytest.raises(StageError, match="give the folder"):
        load_scene(tmp_path / "a")


@pytest.mark.parametrize(
    "time_step, rate, steps",
    [
        (1e-3, 125.0, 2),
        (0.5e-3, 500.0, 4),
        (0.5e-3, 250.0, 4),
        (4e-3, 250.0, 1),
        (1e-3, 1e3 / 3, 1),
    ],
)
def test_power_is_sampled_at_least_every_2_ms_and_whenever_the_sheet_is(time_step, rate, steps):
    numerics = Numerics(time_step=time_step)
    assert numerics.balance_steps(rate) == steps
    assert numerics.sampling_steps(rate) % steps == 0


def test_a_motion_that_comes_to_rest_early_stays_there_between_its_shapes():
    """A rest was one long piece of the spline through the shapes, which left it by 100 degrees."""
    scene = load_scene(CASES / "single_finger", "smoke")
    path = scene.folder / str(scene.motion.states)
    states = read_states(path, scene.finger.thickness)
    time = np.linspace(0, scene.motion.end_time, 43)
    at = np.minimum(40 + 4 * np.arange(len(time)), 80)  # states: it rests after 0.1 s
    moving = States(time, states.profile[at], states.thickness[at])
    law = kinematics_values(scene, moving)
    rest = law["shape_outline"][-1]
    seen = CubicSpline(law["shape_parameter"], law["shape_outline"])(time[time > 0.11])
    assert np.abs(seen - rest).max() < 0.01 * scene.finger.length
