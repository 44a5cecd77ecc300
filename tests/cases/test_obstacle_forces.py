"""A finger between two cylinders: what the water does to each, of the solver."""

import numpy as np
import pytest

from pipeline.scene.scene import load_scene
from pipeline.solve.stage import run
from tests.cases.conftest import table
from tests.conftest import prepare, run_stage, write_scene

pytestmark = pytest.mark.openfoam

BESIDE = """
[motion]
strokes = [{ pressure_kpa = 12.0, start = 0.01, duration = 0.06 }]
end_time = 0.03
[[obstacle]]
shape = "circle"
centre = [0.05, 0.17]
diameter = 0.02
[[obstacle]]
shape = "circle"
centre = [-0.05, 0.17]
diameter = 0.02
depth = 0.06
"""


@pytest.mark.slow
def test_a_coupled_finger_pushes_the_cylinder_ahead_of_it(tmp_path):
    text = BESIDE.rpartition("[[obstacle]]")[0].replace("= 0.01,", "= 0.002,")
    text = text.replace("end_time = 0.03", 'end_time = 0.024\nsource = "structure"')
    scene = write_scene(tmp_path / "s", more=text)
    run_stage(prepare(scene), "solve")
    finger, ahead = (table(scene, f"forces{n}") for n in ("", "_obstacle_1"))
    first = int(np.abs(finger[:, 1]).argmax())
    assert np.isfinite(ahead).all()
    assert 0 < ahead[first, 1] < 0.5 * np.abs(finger[first, 1])


@pytest.mark.parametrize("kind", ["2d", "half"])
def test_an_accelerating_finger_pushes_one_cylinder_and_pulls_the_other(tmp_path, kind):
    """As in water without friction: pressure rises ahead of the finger and falls behind it."""
    scene = write_scene(tmp_path / "s", kind, BESIDE)
    prepare(load_scene(scene.folder, "tiny"))
    run(scene, quiet=True)
    finger, ahead, behind = (table(scene, f"forces{n}") for n in ("", "_obstacle_1", "_obstacle_2"))
    time, rest = finger[:, 0], finger[:, 0] < 0.0095
    first = int(np.abs(finger[:, 1]).argmax())  # while the finger accelerates
    largest = abs(finger[first, 1])
    for forces in (ahead, behind):
        assert np.isfinite(forces).all()
        assert (forces[:, 0] == time).all()
        assert np.abs(forces[rest, 1:3]).max() < 1e-9 * largest  # the finger is at rest
        # three tip widths away: felt, and far less than by the finger itself
        assert 0.002 * largest < forces[first, 1] < 0.5 * largest
    assert finger[first, 1] < 0  # the water resists
