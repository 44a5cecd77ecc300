"""[current]: its law over time and height, and currents that a tank cannot carry."""

import re
from pathlib import Path

import numpy as np
import pytest

from pipeline.formats.mesh_intervals import read_intervals
from pipeline.kinematics import stage as kinematics
from pipeline.kinematics.camera_window import following, tip_path
from pipeline.mesh import stage as mesh
from pipeline.scene.current import Stream, lead_steps
from pipeline.scene.scene import Scene, load_scene
from piv.files.errors import StageError
from tests.conftest import CASES


def scene_of(folder: Path, text: str, level: str = "smoke") -> Scene:
    folder.mkdir(exist_ok=True)
    (folder / "scene.toml").write_text(f'extends = "{CASES / "single_finger"}"\n{text}')
    return load_scene(folder, level)


@pytest.mark.parametrize(
    "text, words",
    [
        ("[current]\n", ["current", "either speed or table"]),
        ("[current]\nspeed = 0.0", ["still water", "remove"]),
        ("[current]\nspeed = 0.1\ntable = 'u.csv'", ["either speed or table"]),
        ("[current]\nspeed = 0.1\namplitude = 0.1", ["amplitude and frequency"]),
        ("[current]\nspeed = 0.1\nthickness = 0.1", ["boundary_layer"]),
        ("[current]\nspeed = 0.1\nramp = 0.2\nlead = 1.0", ["lead", "remove it, or ramp"]),
        ("[current]\nspeed = 0.1\nthicknes = 0.1", ["current.thicknes", "not known"]),
        ("[current]\nspeed = 0.1\nprofile = 'channel'\nwalls = 'slip'", ["channel", "remove"]),
        ("[current]\ntable = 'u.csv'", ["u.csv", "no such file"]),
        ("[current]\nspeed = 0.0\namplitude = 0.1\nfrequency = 1.0\nlead = 1.0", ["runs at 0 s"]),
    ],
)
def test_keys_that_do_not_go_together_are_refused(tmp_path, text, words):
    with pytest.raises(StageError) as caught:
        scene_of(tmp_path / "s", text)
    message = str(caught.value)
    assert "\n" not in message
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    "text, key, given, word",
    [
        ("speed = 0.9", "speed", "at most ([0-9.]+) m/s", "Froude"),
        ("speed = 1e-4\nlead = 1e5", "lead", "lead = ([0-9.]+)", "past the body"),
        ("speed = 0.1\nramp = 0.01", "ramp", "at least ([0-9.]+)", "time_step"),
        ("speed = 0.1\namplitude = 0.1\nfrequency = 50.0", "frequency", "at most ([0-9.]+)", "20"),
        ('speed = 0.1\nprofile = "boundary_layer"\nthickness = 0.4', "thickness",
         "at most ([0-9.]+)", "water_depth"),
    ],
)  # fmt: skip
def test_a_refused_value_names_the_nearest_that_works(tmp_path, text, key, given, word):
    with pytest.raises(StageError, match=word) as caught:
        scene_of(tmp_path / "s", f"[current]\n{text}")
    nearest = re.search(given, str(caught.value))[1].rstrip(".")
    lines = text.replace(re.search(rf"{key} = [0-9.e]+", text)[0], f"{key} = {nearest}")
    assert scene_of(tmp_path / "s", f"[current]\n{lines}").current is not None


@pytest.mark.parametrize(
    "more, given, word",
    [
        ("[numerics]\nmax_courant = 0.1", r"numerics.time_step = ([0-9.e-]+)", "Courant"),
        ("[tank]\nsize = [0.3, 0.33, 0.3]", r"tank.size\[0\] = ([0-9.]+)", "outflow"),
        ("[tank]\nwater_depth = 0.2\n[finger]\nroot = [0.0, 0.18]",
         r"tank.water_depth = ([0-9.]+)", "cross-section"),
    ],
)  # fmt: skip
def test_a_tank_or_mesh_that_cannot_carry_a_current_is_refused(tmp_path, more, given, word):
    text = "[current]\nspeed = 0.1\n"
    with pytest.raises(StageError, match=word) as caught:
        scene_of(tmp_path / "s", text + more)
    nearest = re.search(given, str(caught.value))[1].rstrip(".")
    fixed = {
        "Courant": more + f"\ntime_step = {nearest}",
        "outflow": f"[tank]\nsize = [{nearest}, 0.33, 0.3]",
        "cross-section": more.replace("0.2\n", f"{nearest}\n"),
    }[word]
    assert scene_of(tmp_path / "s", text + fixed).current is not None


def test_no_current_crosses_a_plane_of_symmetry(tmp_path):
    text = f'extends = "{CASES / "pinch"}"\n[current]\nspeed = 0.1\n'
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(StageError, match="'half' or 'full'"):
        load_scene(tmp_path, "smoke")
    (tmp_path / "scene.toml").write_text(text + '[levels.coarse]\nmodel = { kind = "half" }\n')
    assert load_scene(tmp_path, "coarse").both_fingers


def test_the_law_begins_smoothly_and_swings(tmp_path):
    keys = 'speed = 0.1\namplitude = 0.02\nfrequency = 5.0\nramp = 0.2\ndirection = "-x"'
    stream = Stream.of(scene_of(tmp_path / "s", f"[current]\n{keys}"))
    time = np.linspace(0, 0.42, 4201)
    speed = stream.law(time)
    late = time > 0.2
    assert speed[late] == pytest.approx(-0.1 - 0.02 * np.sin(10 * np.pi * time[late]))
    assert speed[0] == 0 == stream.begins
    slope = np.gradient(speed, time)
    assert abs(slope[1]) < 1e-3 * np.abs(slope).max()  # it grows with the square of time
    assert stream.peak(0.42, 2e-3) == pytest.approx(0.12, rel=1e-3)


def test_a_table_is_followed_without_overshoot_and_kept_after_it(tmp_path):
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "u.csv").write_text("t [ms],u [cm/s]\n0,0\n100,10\n200,10\n")
    stream = Stream.of(scene_of(tmp_path / "s", "[current]\ntable = 'u.csv'"))
    assert stream.law(np.array([0.0, 0.1, 0.2, 5.0])) == pytest.approx([0.0, 0.1, 0.1, 0.1])
    assert stream.law(np.linspace(0, 0.2, 101)).max() <= 0.1 + 1e-12


@pytest.mark.parametrize(
    "rows, words",
    [
        ("0,100\n1,200", r"200 m/s.*u \[cm/s\]"),
        # its first or last speed was taken for all of the run
        ("5,0.1\n6,0.2", r"current.table = 'u.csv' has times from .* 0 to 0.42 s"),
        ("-6,0.1\n-5,0.2", r"current.table = 'u.csv' has times from .* 0 to 0.42 s"),
    ],
)
def test_a_table_in_another_unit_or_of_another_time_is_refused(tmp_path, rows, words):
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "u.csv").write_text(f"t,u\n{rows}\n")
    with pytest.raises(StageError, match=words):
        scene_of(tmp_path / "s", "[current]\ntable = 'u.csv'")


def test_a_table_is_named_from_the_scene_that_extends_its_scene(tmp_path):
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "u.csv").write_text("t,u\n0,0.1\n1,0.2\n")
    scene_of(tmp_path / "s", "[current]\ntable = 'u.csv'")
    (tmp_path / "child").mkdir()
    (tmp_path / "child" / "scene.toml").write_text('extends = "../s"\n')
    assert Stream.of(load_scene(tmp_path / "child", "smoke")).begins == pytest.approx(0.1)


def test_the_profile_at_the_bottom_is_pohlhausens(tmp_path):
    """Its displacement thickness is 0.3 of its thickness, by integration of 2η - 2η³ + η⁴."""
    keys = 'speed = 0.1\nprofile = "boundary_layer"\nthickness = 0.1'
    stream = Stream.of(scene_of(tmp_path / "s", f"[current]\n{keys}"))
    height = np.linspace(0, 0.3, 30001)
    assert np.trapezoid(1 - stream.share(height), height) == pytest.approx(0.03, rel=1e-6)
    assert stream.share(height[height >= 0.1]) == pytest.approx(1.0)


def test_a_current_has_run_before_the_motion_unless_it_begins_from_rest(tmp_path):
    running = scene_of(tmp_path / "s", "[current]\nspeed = 0.1")
    assert lead_steps(running) * running.numerics.time_step == pytest.approx(5 * 0.07 / 0.1)
    wide = scene_of(tmp_path / "s", "[current]\nspeed = 0.1", "draft")  # water goes around it
    assert lead_steps(wide) * wide.numerics.time_step == pytest.approx(5 * 0.028 / 0.1)
    given = scene_of(tmp_path / "s", "[current]\nspeed = 0.1\nlead = 0.5")
    assert lead_steps(given) * given.numerics.time_step == pytest.approx(0.5)
    assert lead_steps(scene_of(tmp_path / "s", "[current]\nspeed = 0.1\nramp = 0.3")) == 0
    assert lead_steps(scene_of(tmp_path / "s", "")) == 0


def test_a_body_that_takes_much_of_the_cross_section_is_remarked(tmp_path):
    scene = scene_of(tmp_path / "s", "[current]\nspeed = 0.1")
    assert any("23 % of the tank's cross-section" in remark for remark in scene.remarks())
    scene = scene_of(tmp_path / "s", "[current]\nspeed = 0.1", "draft")
    assert not any("cross-section" in remark for remark in scene.remarks())


def view_of(scene: Scene) -> dict:
    return following(scene, tip_path(scene))


def test_the_view_holds_where_a_current_carries_vortices(tmp_path):
    """By half a finger's length at most, downstream alone."""
    motion = "[motion]\nend_time = 0.8\n"  # without a view of its parent's
    still = view_of(scene_of(tmp_path / "s", motion))
    moving = view_of(scene_of(tmp_path / "s", f"{motion}[current]\nspeed = 0.1\n"))

    def ends(view):
        half = 0.5e-3 * view["camera.columns"] * view["camera.scale_mm_per_px"]
        return np.array([-half, half]) + view["camera.centre"][0]

    grown = ends(moving) - ends(still)
    assert grown[1] > 0.5 * 0.035
    assert abs(grown[0]) < 0.5 * grown[1]


def test_a_rigid_body_may_rest_in_a_current_alone(tmp_path):
    """Its mesh then stands still. Of still water there would be nothing to see."""
    scene = load_scene(CASES / "validation" / "cylinder_in_current", "tiny", out=tmp_path)
    kinematics.run(scene, quiet=True)
    mesh.run(scene, quiet=True)
    assert [interval.moving for interval in read_intervals(tmp_path)] == [False]
    with pytest.raises(StageError, match="water would stand still"):
        kinematics.run(scene.model_copy(update={"current": None}), quiet=True)


def test_a_channel_has_a_parabola_and_no_waves(tmp_path):
    """1 m/s would be refused below a free surface."""
    text = "[current]\nspeed = 1.0\nprofile = 'channel'\n[numerics]\ntime_step = 5e-4\n"
    scene = scene_of(tmp_path / "s", text)
    stream, depth = Stream.of(scene), scene.tank.water_depth
    height = depth * (np.arange(1000) + 0.5) / 1000
    assert stream.share(height).mean() == pytest.approx(1.0, abs=1e-6)
    assert stream.share(np.array([0.0, 0.5, 1.0]) * depth) == pytest.approx([0.0, 1.5, 0.0])
    assert stream.peak(0.1, 0.01) == pytest.approx(1.5)


def test_a_finger_that_lies_with_the_stream_takes_less_room(tmp_path):
    """70 mm: of its length nothing is across the stream, and nothing reaches against it."""
    text = "[current]\nspeed = 0.1\n[finger]\nroot = [{}, 0.15]\ntilt_deg = {}\n"
    scene_of(tmp_path / "with", text.format(-0.25, 90.0))
    with pytest.raises(StageError, match="inflow"):
        scene_of(tmp_path / "against", text.format(-0.25, -90.0))
    with pytest.raises(StageError, match="inflow"):
        scene_of(tmp_path / "hangs", text.format(-0.25, 0.0))


def test_only_a_current_moves_a_finger_without_pressure(tmp_path):
    text = "[motion]\nstrokes = []\n"
    assert scene_of(tmp_path / "runs", f"{text}[current]\nspeed = 0.1\n").motion.strokes == ()
    with pytest.raises(StageError, match=r"no pressure moves the finger.* \[current\]"):
        scene_of(tmp_path / "still", text)
