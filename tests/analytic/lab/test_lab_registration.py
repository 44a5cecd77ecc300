"""The finger is found where it was drawn: pose, scale, bend and time."""

from dataclasses import replace

import numpy as np
import pytest

from docs.evidence.lab_renderer import Faults, Rendered
from pipeline.formats.kinematics import counter_clockwise
from postprocess.lab.causes import check_fit
from postprocess.lab.pose import Pose, camera_series
from postprocess.lab.register import Known, fit_pictures, register
from postprocess.lab.silhouette import integral_image
from tests.lab_scene import finger_kinematics, inside_sum, vortex_series

TIMES, SHAPE, SCALE, DELAY, FACTOR = np.linspace(0.0, 0.42, 24), (320, 400), 0.4, 0.007, 1.05


@pytest.fixture(scope="module")
def kinematics(tmp_path_factory):
    return finger_kinematics(tmp_path_factory.mktemp("lab"))


def poses(kinematics, scale_error=0.01):
    """What the laboratory states, and what is true."""
    at = 150.0, 270.0
    true = Pose(SCALE * (1 + scale_error), np.radians(2.0), kinematics.root, (152.5, 268.5))
    return Pose(SCALE, 0.0, kinematics.root, at), true


def stills(kinematics, lag=0.0, faults=None, **more):
    """Pictures of the finger of a law that is 5 % stronger and 7 ms late, and its pressures."""
    pressures = FACTOR * kinematics.law(np.clip(TIMES - DELAY, *kinematics.time)) - lag
    return Rendered(kinematics, poses(kinematics, **more)[1], pressures, SHAPE, faults), pressures


@pytest.fixture(scope="module")
def registered_lab(kinematics):
    known = Known(poses(kinematics)[0], scale_std=0.01)
    return found(stills(kinematics)[0], kinematics, known)


def found(recording, kinematics, known):
    """The registration of pictures."""
    return register(fit_pictures(recording, TIMES, kinematics, known), kinematics, known)


def dense(corners, pieces=50):
    """A polygon with its sides cut in pieces."""
    sides = zip(corners, np.roll(corners, -1, 0), strict=True)
    lines = [np.linspace(a, b, pieces, endpoint=False) for a, b in sides]
    return counter_clockwise(np.vstack(lines))


@pytest.mark.parametrize("mean", [0.0, -0.15])
def test_inside_sum_does_not_see_what_lies_outside(mean):
    """The evidence to the left of the two sides of a body must cancel, however much it is."""
    rng = np.random.default_rng(2)
    corners = np.array([[100.0, 20.0], [120.3, 21.0], [119.1, 180.2], [98.8, 179.2]])
    image = np.zeros((200, 240), np.float32)
    image[:, :96] = -rng.poisson(0.3, (200, 96))
    image[:, 125:] = -rng.poisson(0.3, (200, 115))
    integral = integral_image(image, mean).astype(np.float32)
    for pieces in (4, 13, 90):  # however the sides are cut
        assert abs(inside_sum(integral, dense(corners, pieces), mean)) < 0.05


def test_pose_scale_and_time_are_found(registered_lab, kinematics):
    registration, true = registered_lab, poses(kinematics)[1]
    # a camera of 400 px, 0.4 mm/px: what the target asks of a larger one, doubled
    assert np.abs(np.array(registration.pose.at_px) - true.at_px).max() * SCALE < 0.6
    assert abs(np.degrees(registration.pose.angle - true.angle)) < 1.0
    # it must improve on the stated 1 %: half of it; 0.40 to 0.42 % with three seeds
    assert np.sqrt(registration.covariance[3, 3]) < 0.005
    assert registration.law.delay == pytest.approx(DELAY, abs=0.003)
    assert registration.law.values[0] == pytest.approx(FACTOR, abs=0.02)
    assert (off(registration, true) < 4).all()
    assert (np.sqrt(np.diag(registration.covariance)) < [2.0, 2.0, 0.02, 0.01]).all()


def off(registration, true):
    """Errors of the pose over their standard uncertainties."""
    pose, scale = registration.pose, np.log(true.pixel / registration.pose.pixel)
    errors = [*(np.array(pose.at_px) - true.at_px), pose.angle - true.angle, scale]
    return np.abs(errors) / np.sqrt(np.diag(registration.covariance))


def test_a_hidden_root_is_told_and_left_out(kinematics):
    """A dark holder hides the upper 8 mm of the finger."""
    held, _ = stills(kinematics, faults=Faults(holder=0.008), scale_error=0.002)
    stated, true = poses(kinematics, 0.002)
    known = Known(stated, scale_std=0.003)
    check = check_fit(fit_pictures(held, TIMES, kinematics, known), kinematics, known)
    assert "or give root_hidden_mm where its root is not" in check.refusals[0]
    registration = found(held, kinematics, replace(known, hidden=0.011))
    assert (off(registration, true) < 4).all()
    assert registration.law.delay == pytest.approx(DELAY, abs=0.003)


def test_a_motion_of_another_shape_is_followed_frame_by_frame(kinematics):
    """A finger that lags by up to 3 % of the range in the middle of its stroke."""
    lag = 0.03 * 20e3 * np.sin(np.pi * np.clip(TIMES / 0.4, 0, 1)) ** 2
    recording, pressures = stills(kinematics, lag)
    known = Known(poses(kinematics)[0], scale_std=0.01)
    registration = found(recording, kinematics, known)
    error = registration.pressures - pressures
    assert np.sqrt(np.mean(error**2)) < 0.02 * 20e3  # single frames of a small picture


def test_camera_planes_turn_positions_and_vectors(kinematics):
    times = np.linspace(0.0, 0.1, 6)
    series = vortex_series(kinematics, times, spacing=2e-3)
    pose = Pose(1 / 4.0, 0.5, kinematics.root, (300.0, 450.0))
    x, y = np.linspace(0.02, 0.13, 23), np.linspace(0.02, 0.11, 19)
    plane = camera_series(series, pose, x, y, times[2:3]).isel(time=0)
    gx, gy = np.meshgrid(x, y)
    at = pose.from_camera(np.stack([gx, gy], -1))
    centre = series["tip"].values[2, 0] + 0.016 * series["dorsal_direction"].values[2, 0]
    d = at - centre
    r2 = (d**2).sum(-1)
    swirl = -0.012 * (0.3 + times[2]) / (2 * np.pi * r2) * (1 - np.exp(-r2 / 0.006**2))
    exact = np.stack([-swirl * d[..., 1], swirl * d[..., 0]], -1) @ pose.rotation.T
    error = np.stack([plane["u"].values, plane["v"].values], -1) - exact
    inside = np.isfinite(error).all(-1)
    assert inside.sum() > 200
    assert np.nanpercentile(np.abs(error), 95) < 0.01 * np.nanmax(np.abs(exact))
    assert np.allclose(plane["tip"].values[0], pose.to_camera(series["tip"].values[2, 0]))


def test_a_second_finger_is_the_mirror_image(kinematics):
    pair = replace(kinematics, mirror=True)
    outlines, bends = pair.fingers("outline", 1e4), pair.fingers("bend", 1e4)
    assert np.allclose(outlines[1], outlines[0] * [-1, 1])
    assert bends[0] == bends[1]


def test_pose_there_and_back():
    pose = Pose(1 / 3.9, -0.3, (0.01, 0.24), (200.0, 400.0))
    points = np.random.default_rng(1).uniform(-0.1, 0.3, (20, 2))
    assert np.allclose(pose.to_tank(pose.to_px(points)), points)
    assert np.allclose(pose.from_camera(pose.to_camera(points)), points)
