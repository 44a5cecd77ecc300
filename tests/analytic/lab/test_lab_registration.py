"""Evidence within an outline, and planes in the frame of a camera."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.formats.kinematics import counter_clockwise
from postprocess.lab.outline_profile import dense
from postprocess.lab.pose import Pose, camera_series
from postprocess.lab.silhouette import integral_image
from tests.lab_scene import finger_kinematics, inside_sum, vortex_series


@pytest.fixture(scope="module")
def kinematics(tmp_path_factory):
    return finger_kinematics(tmp_path_factory.mktemp("lab"))


@pytest.mark.parametrize("mean", [0.0, -0.15])
def test_inside_sum_does_not_see_what_lies_outside(mean):
    """The evidence to the left of the two sides of a body must cancel, however much it is."""
    rng = np.random.default_rng(2)
    corners = np.array([[100.0, 20.0], [120.3, 21.0], [119.1, 180.2], [98.8, 179.2]])
    image = np.zeros((200, 240), np.float32)
    image[:, :96] = -rng.poisson(0.3, (200, 96))
    image[:, 125:] = -rng.poisson(0.3, (200, 115))
    integral = integral_image(image, mean).astype(np.float32)
    for per_px in (0.02, 0.1, 1):  # however the sides are cut
        outline = dense(counter_clockwise(corners), per_px)[0]
        assert abs(inside_sum(integral, outline, mean)) < 0.05


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
