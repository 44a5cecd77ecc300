"""A round body that carries the finger: one outline with rounded corners, part of it at rest."""

import numpy as np
import pytest
import shapely

from pipeline.formats.kinematics import read_kinematics
from pipeline.kinematics import stage as kinematics
from pipeline.kinematics.shapes import FingerShapes, circular_states, rounded_strip, with_mount
from pipeline.mesh import stage as mesh
from pipeline.scene.scene import load_scene
from pipeline.scene.sections import Mount
from tests.conftest import CASES

LENGTH, HEIGHT, CORNER, DIAMETER = 0.35, 0.02, 0.004, 0.1


def shapes() -> FingerShapes:
    states = circular_states(np.array([-1e3, 0.0, 1e3]), np.array([-0.6, 0, 0.6]), LENGTH, HEIGHT)
    s = np.linspace(0, LENGTH, states.thickness.shape[1])
    strip = rounded_strip(LENGTH, states.thickness[1], s, 0.0, 0.001, 9600)
    mount = Mount(diameter=DIAMETER, corner_radius=CORNER)
    return FingerShapes(states, with_mount(strip, mount, states.thickness[1], s))


def test_outline_of_finger_and_mount():
    outline = shapes().outline(0.0)
    body = shapely.Polygon(outline)
    assert body.is_valid
    assert outline[:, 0].min() == pytest.approx(-DIAMETER, abs=1e-5)
    assert outline[:, 0].max() == pytest.approx(LENGTH, abs=1e-5)
    finger = shapely.box(0, -HEIGHT / 2, LENGTH, HEIGHT / 2)
    sharp = shapely.Point(-DIAMETER / 2, 0).buffer(DIAMETER / 2, 90) | finger
    sharp |= shapely.box(-DIAMETER / 2, -HEIGHT / 2, 0, HEIGHT / 2)
    # two corners of 102 deg are filled and two of 90 deg cut
    turn = np.pi / 2 - np.arcsin(HEIGHT / DIAMETER)
    filled = 2 * CORNER**2 * (np.tan(turn / 2) - turn / 2)
    assert body.area - sharp.area == pytest.approx(filled, rel=0.3)
    # a disc of the corners' radius fits into them from outside
    assert body.buffer(CORNER).buffer(-CORNER).area == pytest.approx(body.area, rel=1e-4)


def test_the_mount_rests_while_the_finger_bends():
    still, bent = (shapes().outline(p) for p in (0.0, 1e3))
    behind = still[:, 0] < 0
    np.testing.assert_array_equal(bent[behind], still[behind])
    assert np.abs(bent - still).max() > 0.05
    steps = [np.hypot(*np.diff(line, axis=0).T) for line in (still, bent)]
    np.testing.assert_allclose(steps[1], steps[0], rtol=0.12, atol=1e-4)


def test_the_walls_layers_fit_into_the_corners(tmp_path):
    """Turek and Hron's flag, whose layers would cross in a sharp corner."""
    folder = CASES / "validation" / "turek_hron"
    scene = load_scene(folder, "h1", {"motion.source": "fea"}, tmp_path)
    kinematics.run(scene, quiet=True)
    mesh.run(scene, quiet=True)
    quality = np.genfromtxt(tmp_path / "mesh_quality.csv", delimiter=",", names=True)
    assert quality["max_non_orthogonality_deg"].max() < 50
    assert read_kinematics(tmp_path / "kinematics.h5").data["shape_bend"].values.max() == 0
