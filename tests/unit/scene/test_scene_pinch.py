"""The fingers of a pinch hang where the scene places them; shapes through bodies are refused."""

import pytest

from pipeline.kinematics.stage import kinematics_values
from pipeline.scene.scene import load_scene
from piv.files.errors import StageError
from tests.conftest import CASES, write_scene

BACK = """[motion]
start_pressure_kpa = 20.0
strokes = [{ pressure_kpa = 0.0, start = 0.005, duration = 0.4 }]
"""
OBJECT = """[pinch]
half_distance = 0.045
residual_gap = 0.0005
object = { diameter = 0.07, centre_height = 0.18 }
[finger]
tilt_deg = 20.0
"""
SUPPORT = "[support]\nsize = [{x}, {h}, 0.05]\nbottom = {y}\n"


def test_a_quarter_needs_a_pinch_and_a_pinch_is_a_quarter(tmp_path):
    with pytest.raises(StageError, match=r"needs the second symmetry plane of \[pinch\]"):
        write_scene(tmp_path / "single", "quarter")
    folder = tmp_path / "alone"
    folder.mkdir()
    text = (CASES / "single_finger/scene.toml").read_text()
    text = text.replace('[model]\nkind = "half"', "[pinch]\nhalf_distance = 0.05")
    (folder / "scene.toml").write_text(text)
    assert load_scene(folder, "coarse").model.kind == "quarter"
    assert load_scene(folder, "smoke").model.kind == "2d"


@pytest.mark.parametrize("kind", ["2d", "quarter", "half", "full"])
def test_finger_0_hangs_left_of_the_plane(tmp_path, kind):
    scene = write_scene(tmp_path / kind, kind, "[pinch]\nhalf_distance = 0.05", parent="pinch")
    assert scene.finger.root == (-0.05, 0.245)
    assert write_scene(tmp_path / "single").finger.root == (0.0, 0.245)


@pytest.mark.parametrize(
    "more, words",
    [
        (BACK, r"gap of -4\.0\d mm to the plane"),
        ("[finger]\ntilt_deg = 40.0\n", r"gap of -\d\.\d\d mm to the plane"),
        (OBJECT, "to the plane or the object"),
    ],
)
def test_shapes_beyond_the_plane_are_refused(tmp_path, more, words):
    with pytest.raises(StageError, match=words):
        kinematics_values(write_scene(tmp_path / "a", "quarter", more, parent="pinch"))


def test_a_finger_that_curls_into_the_support_is_refused(tmp_path):
    curl = "[motion]\nstrokes = [{ pressure_kpa = 39.0, start = 0.005, duration = 0.4 }]\n"
    more = curl + SUPPORT.format(x=0.3, h=0.02, y=0.2451)
    scene = write_scene(tmp_path / "s", "half", more + "[finger.tip]\nlength = 0.03\n")
    with pytest.raises(StageError, match=r"touches the support at 1\d\d\.\d° of bend; raise"):
        kinematics_values(scene)
    kinematics_values(write_scene(tmp_path / "t", "half", SUPPORT.format(x=0.3, h=0.02, y=0.245)))
