"""A pinch that cannot be is refused in one sentence; the fingers hang where it says."""

import pytest

from fileio.errors import StageError
from pipeline.kinematics.stage import kinematics_values
from pipeline.scene.scene import load_scene
from pipeline.stage_settings import write_settings
from tests.conftest import ROOT, write_scene

OBJECT = "[pinch.object]\ndiameter = {d}\ncentre_height = {y}\n"
SUPPORT = "[support]\nsize = [{x}, {h}, 0.05]\nbottom = {y}\n"


@pytest.mark.parametrize(
    "more, words",
    [
        ("[finger]\nroot = [0.01, 0.245]", ["finger.root[0]", "half_distance only"]),
        ('[finger]\nventral = "-x"', ["finger.ventral", "towards each other"]),
        ("[pinch]\nhalf_distance = 0.3", ["pinch.half_distance", "walls", "0.29275"]),
        (
            "[pinch]\nhalf_distance = 0.0105",
            ["pinch.half_distance", "0.0035", "raise half_distance"],
        ),
        ("[pinch]\nresidual_gap = 0.0", ["pinch.residual_gap", "got 0"]),
        ('[pinch]\nclosing_law = "sudden"', ["pinch.closing_law", "ramp", "sudden"]),
        ("[pinch]\ngap = 0.001", ["pinch.gap", "not known"]),
        ("[sheet]\nz = 0.01", ["sheet.z", "symmetry plane"]),
        (OBJECT.format(d=0.03, y=0.29), ["pinch.object.centre_height", "out of the water"]),
        (OBJECT.format(d=0.08, y=0.19), ["pinch.object.diameter", "opening", "0.0745"]),
        ("[pinch.object]\ndiameter = 0.02", ["pinch.object.centre_height", "missing"]),
        (SUPPORT.format(x=0.1, h=0.01, y=0.24), ["support.bottom", "roots"]),
        (SUPPORT.format(x=0.1, h=0.06, y=0.25), ["support.size[1]", "surface"]),
        (SUPPORT.format(x=0.7, h=0.01, y=0.25), ["support.size", "tank"]),
    ],
)
def test_what_cannot_be_is_refused_with_key_and_remedy(tmp_path, more, words):
    with pytest.raises(StageError) as caught:
        write_scene(tmp_path / "bad", "quarter", more, parent="pinch")
    for word in ["scene.toml", *words]:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_quarter_needs_a_pinch_and_a_pinch_is_a_quarter(tmp_path):
    with pytest.raises(StageError, match=r"needs the second symmetry plane of \[pinch\]"):
        write_scene(tmp_path / "single", "quarter")
    folder = tmp_path / "alone"
    folder.mkdir()
    text = (
        (ROOT / "cases/single_finger/scene.toml")
        .read_text()
        .replace('[model]\nkind = "half"', "[pinch]\nhalf_distance = 0.05")
    )
    (folder / "scene.toml").write_text(text)
    assert load_scene(folder, "coarse").model.kind == "quarter"
    assert load_scene(folder, "smoke").model.kind == "2d"


@pytest.mark.parametrize("kind", ["2d", "quarter", "half", "full"])
def test_finger_0_hangs_left_of_the_plane(tmp_path, kind):
    scene = write_scene(tmp_path / kind, kind, "[pinch]\nhalf_distance = 0.05", parent="pinch")
    assert scene.finger.root == (-0.05, 0.245)
    assert write_scene(tmp_path / "single").finger.root == (0.0, 0.245)


def test_shapes_beyond_the_plane_are_refused(tmp_path):
    strokes = "[motion]\nstart_pressure_kpa = 20.0\nstrokes = [{ pressure_kpa = 0.0, start = 0.005, duration = 0.4 }]\n"
    with pytest.raises(StageError, match=r"gap of -4\.0\d mm to the plane"):
        kinematics_values(write_scene(tmp_path / "a", "quarter", strokes, parent="pinch"))
    tilted = "[finger]\ntilt_deg = 40.0\n"
    with pytest.raises(StageError, match=r"gap of -\d\.\d\d mm to the plane"):
        kinematics_values(write_scene(tmp_path / "b", "quarter", tilted, parent="pinch"))
    inside = (
        OBJECT.format(d=0.07, y=0.18) + "[pinch]\nhalf_distance = 0.045\nresidual_gap = 0.0005\n"
    )
    with pytest.raises(StageError, match="to the plane or the object"):
        kinematics_values(
            write_scene(
                tmp_path / "c", "quarter", inside + "[finger]\ntilt_deg = 20.0", parent="pinch"
            )
        )


def test_a_finger_that_curls_into_the_support_is_refused(tmp_path):
    curl = "[motion]\nstrokes = [{ pressure_kpa = 39.0, start = 0.005, duration = 0.4 }]\n"
    more = curl + SUPPORT.format(x=0.3, h=0.02, y=0.2451)
    with pytest.raises(StageError, match=r"touches the support at 1\d\d\.\d° of bend; raise"):
        kinematics_values(
            write_scene(tmp_path / "s", "half", more + "[finger.tip]\nlength = 0.03\n")
        )
    kinematics_values(write_scene(tmp_path / "t", "half", SUPPORT.format(x=0.3, h=0.02, y=0.245)))


def test_the_residual_gap_redoes_the_motion_and_no_settings_else(tmp_path):
    folder = tmp_path / "scene"
    write_settings(write_scene(folder, "quarter", parent="pinch"))
    after = write_scene(folder, "quarter", "[pinch]\nresidual_gap = 1e-3", parent="pinch")
    assert write_settings(after) == ["kinematics"]
    after = write_scene(
        folder,
        "quarter",
        "[pinch]\nresidual_gap = 1e-3\n" + SUPPORT.format(x=0.1, h=0.02, y=0.255),
        parent="pinch",
    )
    assert set(write_settings(after)) == {"kinematics", "mesh"}
