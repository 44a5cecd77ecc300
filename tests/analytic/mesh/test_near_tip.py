"""Where mesh.near_cell holds: along the tip's whole path, or beside the tip that is meshed."""

import numpy as np
import pytest

from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.mesh_intervals import read_planform
from pipeline.geometry.quality import cell_areas, cell_centres
from pipeline.kinematics import stage as kinematics
from pipeline.mesh import stage as mesh
from pipeline.mesh.shape_sequence import behind_tip
from tests.conftest import write_scene


def test_cells_are_small_about_the_tip_alone_where_they_move_with_it(tmp_path):
    largest = {}
    for near in ("path", "tip"):
        scene = write_scene(tmp_path / near, more=f'[mesh]\nnear = "{near}"')
        kinematics.run(scene, quiet=True)
        mesh.run(scene, quiet=True)
        planform, motion = read_planform(scene.out, 0), read_kinematics(scene.out / "kinematics.h5")
        tips = motion.data["shape_tip"].values.reshape(-1, 2)
        built, last = tips[len(tips) // 2], tips[-1]
        cells = planform["triangles"].values, planform["quads"].values
        nodes = planform["points"].values[len(planform["points"]) // 2]
        centres, size = cell_centres(nodes, *cells), np.sqrt(cell_areas(nodes, *cells))
        reach = 0.5 * scene.mesh.near_distance
        for name, tip in (("built", built), ("last", last)):
            largest[near, name] = size[np.hypot(*(centres - tip).T) < reach].max()
    # a triangle of sides h has an area of 0.43 h²; gmsh exceeds h by a few tenths
    limit = scene.mesh.near_cell
    assert max(largest["path", "built"], largest["path", "last"], largest["tip", "built"]) < limit
    assert largest["tip", "last"] > 1.5 * largest["path", "last"]


PARAMETER = np.array([0.0, 1.0, 2.0])
TIPS = np.array([[0.0, 0.0], [0.01, 0.0], [0.02, 0.0]])  # towards +x, away from the dorsal side
DOWN, DORSAL = np.tile([0.0, -1.0], (3, 1)), np.tile([-1.0, 0.0], (3, 1))


@pytest.mark.parametrize(
    "motion, sides",
    [
        (PARAMETER, [-1]),
        (PARAMETER[::-1], [1]),
        ([0.0, 2.0, 0.0], [-1, 1]),
        ([0.0, 2.0, 1.9], [-1]),  # it swings back by a twentieth
        ([0.0, 0.0], [-1]),  # at rest the side does not matter
    ],
)
def test_small_cells_lie_on_each_side_that_the_tip_comes_from(motion, sides):
    places = behind_tip(PARAMETER, TIPS, DOWN, DORSAL, np.array(motion), (0.005, 0.016))
    wanted = [TIPS + np.array([side * 0.016, -0.005]) for side in sides]
    np.testing.assert_allclose(places, np.stack(wanted, axis=1))


def test_small_cells_of_a_body_are_about_each_of_its_edges():
    edges = np.stack([TIPS, TIPS + 0.1], axis=1)
    places = behind_tip(PARAMETER, edges, DOWN, DORSAL, PARAMETER, (0.0, 0.0))
    np.testing.assert_allclose(places, edges)
