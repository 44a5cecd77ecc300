"""The flow in space: what is drawn is where the flow turns, in the colour of its sense."""

import numpy as np
import pytest
import pyvista as pv

from piv.files.child_process import read_in_child
from postprocess.draw.space import Stage, View

BOX = (-0.05, 0.05, -0.05, 0.05, -0.03, 0.03)


def picture(sense: float) -> np.ndarray:
    """A column of water that turns about z, 15 mm in radius, behind a small body."""
    size = {"dimensions": (51, 51, 13), "spacing": (2e-3, 2e-3, 5e-3), "origin": BOX[::2]}
    water = pv.ImageData(**size).cast_to_unstructured_grid()
    x, y, _ = water.cell_centers().points.T
    core = np.exp(-((x**2 + y**2) / 0.015**2))
    water.cell_data["q"] = 100.0 * (core - 0.5)
    water.cell_data["vorticity"] = sense * 40.0 * core[:, None] * [0, 0, 1]
    walls = pv.Box((-0.045, -0.035, 0.02, 0.04, -0.01, 0.01)).cast_to_unstructured_grid()
    stage = Stage(View(BOX, 10.0, 40.0, 1e-3))
    image = stage.picture(water, walls, 20.0)
    stage.close()
    return image.astype(float)


def test_surfaces_turn_purple_or_orange_with_the_sense_of_rotation():
    try:
        clockwise, counter = (read_in_child(picture, sense) for sense in (-1.0, 1.0))
    except ChildProcessError:
        pytest.skip("VTK cannot draw without a screen here (apt: libegl1 libgl1-mesa-dri)")
    blue, red = clockwise[..., 2] - clockwise[..., 0], counter[..., 0] - counter[..., 2]
    share = 0.03  # of the picture at least: the column fills about a twentieth of it, and the
    # ground is at most 15 grey levels bluer than red
    assert np.mean(blue > 25) > share
    assert np.mean(red > 25) > share
    assert np.mean(counter[..., 2] - counter[..., 0] > 25) < share / 10
    corner = clockwise[-20:, :20].reshape(-1, 3)
    assert corner.min() > 200  # a light ground
