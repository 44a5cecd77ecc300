"""Rigid bodies: laws, outlines, kinematics.h5, and what a scene may say of them."""

import numpy as np
import pytest

from pipeline.formats.kinematics import read_kinematics
from pipeline.kinematics.rigid_body import measured_path, rest_outline, smooth_step, travelled
from pipeline.kinematics.stage import kinematics_values
from pipeline.kinematics.stage import run as run_kinematics
from pipeline.scene.rigid_body import Law, RigidBody
from pipeline.scene.scene import load_scene
from piv.files.errors import StageError

SCENE = """
title = "t"
[tank]
size = [10.0, 10.0, 2.0]
water_depth = 10.0
[body]
{body}
[motion]
source = "rigid"
{motion}
end_time = 2.0
[model]
kind = "2d"
[mesh]
wall_cell = 0.1
wall_first_layer = 0.1
wall_layers = 1
tip_cell = 0.1
near_cell = 0.2
far_cell = 1.0
[numerics]
time_step = 0.01
[sheet]
rate_hz = 10.0
[camera]
centre = [0.0, 5.0]
[levels.coarse]
"""
CIRCLE = 'shape = "circle"\ndiameter = 1.0\ncentre = [0.0, 5.0]'
SINE = 'displacement = { kind = "sine", amplitude = -0.5, period = 1.0, smoothing = 0.3 }'
STROKE = "\nstrokes = [{ pressure_kpa = 1.0, start = 0.1, duration = 0.2 }]"


def scene_of(folder, body=CIRCLE, motion=SINE):
    (folder / "scene.toml").write_text(SCENE.format(body=body, motion=motion))
    return load_scene(folder)


def test_a_power_law_ends_with_the_speed_and_the_way_of_theory():
    path = travelled(Law(kind="power", rate=2.0, exponent=0.0, smoothing=0.1, start=0.05), 1.0)
    assert path.rate[-1] == pytest.approx(2.0)
    # half the smoothing is lost
    assert path.distance[-1] == pytest.approx(2.0 * (1.0 - 0.05 - 0.5 * 0.1), rel=1e-9)
    path = travelled(Law(kind="power", rate=3.0, exponent=1.0, smoothing=0.1), 1.0)
    assert path.rate[-1] == pytest.approx(3.0)


def test_a_measured_path_begins_at_the_bodys_place_and_rests_outside(tmp_path):
    time = np.linspace(0.1, 1.1, 201)
    rows = "".join(f"{t:.6f},{0.5 + 0.3 * np.sin(np.pi * (t - 0.1)) ** 2:.9f}\n" for t in time)
    (tmp_path / "path.csv").write_text("t,x\n" + rows)
    path = measured_path(tmp_path / "path.csv", 1.5)
    assert path.distance[0] == 0
    assert path.rate[-1] == 0
    wanted = 0.3 * np.sin(np.pi * np.clip(path.time - 0.1, 0, 1)) ** 2
    # the law's ends, where the second derivative jumps, are smoothed over four rows
    assert np.abs(path.distance - wanted).max() < 1e-4
    (tmp_path / "path.csv").write_text("t,x\n0,0\n0,1\n1,2\n")
    with pytest.raises(StageError, match=r"path\.csv: times must increase"):
        measured_path(tmp_path / "path.csv", 1.5)


@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_outlines_are_closed_counter_clockwise_and_of_the_right_area(angle):
    def area(p):
        q = np.roll(p, -1, axis=0)
        return 0.5 * np.sum(p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1])

    circle = rest_outline(RigidBody(shape="circle", diameter=2.0, centre=(0, 0)))
    assert area(circle) == pytest.approx(np.pi, rel=1e-4)
    kind = {"shape": "plate", "chord": 1.0, "thickness": 0.1, "angle_deg": angle, "points": 4000}
    plate = rest_outline(RigidBody(centre=(0, 0), **kind))
    assert area(plate) == pytest.approx(0.9 * 0.1 + np.pi * 0.05**2, rel=1e-4)
    assert np.hypot(*plate.T).max() == pytest.approx(0.5, rel=1e-4)


def test_kinematics_hold_the_body_where_its_law_says(tmp_path):
    scene = scene_of(tmp_path)
    run_kinematics(scene, quiet=True)
    motion = read_kinematics(scene.out / "kinematics.h5")
    times = np.linspace(0, 2.0, 101)
    outlines = np.array([motion.at(t)["outline"][0] for t in times])
    wanted = -0.5 * smooth_step(times / 0.3) * np.sin(2 * np.pi * times)
    assert outlines.mean(axis=1)[:, 1] == pytest.approx(5.0)
    assert outlines.mean(axis=1)[:, 0] == pytest.approx(wanted, abs=1e-6)
    speed = [motion.at(t)["outline_velocity"][0].mean(axis=0)[0] for t in times]
    assert speed == pytest.approx(np.gradient(wanted, times), abs=0.1)  # 20 ms apart
    assert motion.data["pressure"].attrs["units"] == "m"


def test_a_rotation_turns_the_plate(tmp_path):
    plate = 'shape = "plate"\nchord = 1.0\nthickness = 0.1\ncentre = [1.0, 5.0]'
    turn = 'rotation = { kind = "power", rate = 90.0, exponent = 0.0, smoothing = 0.2 }'
    data = kinematics_values(scene_of(tmp_path, plate, turn))
    assert np.degrees(data["shape_bend"][-1]) == pytest.approx(90.0 * 1.9, rel=1e-6)
    ends = data["shape_edges"]
    assert np.hypot(*(ends - [1.0, 5.0]).T) == pytest.approx(0.5)


@pytest.mark.parametrize(
    "body, motion, words",
    [
        (CIRCLE + "\nchord = 1.0", SINE, "chord and thickness to a plate"),
        ('shape = "circle"\ncentre = [0.0, 5.0]', SINE, "a diameter to a circle"),
        (CIRCLE, SINE.replace(", period = 1.0", ""), "takes amplitude and period"),
        (CIRCLE, SINE + STROKE, "takes one of .* and no strokes"),
        (CIRCLE, "", "takes one of motion.displacement, rotation and path_csv"),
        (CIRCLE + "\n[finger]\nroot = [0.0, 5.0]", SINE, "either finger or body"),
    ],
)  # fmt: skip
def test_a_scene_that_cannot_be_is_refused_in_one_sentence(tmp_path, body, motion, words):
    with pytest.raises(StageError, match=words):
        scene_of(tmp_path, body, motion)


def test_a_body_that_leaves_the_water_or_never_moves_is_refused(tmp_path):
    with pytest.raises(StageError, match="leaves the water"):
        kinematics_values(scene_of(tmp_path, CIRCLE, SINE.replace("-0.5", "-4.8")))
    late = SINE.replace("smoothing", "start = 2.0, smoothing")
    with pytest.raises(StageError, match="water would stand still"):
        kinematics_values(scene_of(tmp_path, CIRCLE, late))
