"""Where mesh.near_cell holds: along the tip's whole path, or about the tip that is meshed."""

import numpy as np

from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.mesh_intervals import read_planform
from pipeline.geometry.quality import cell_areas, cell_centres
from pipeline.kinematics import stage as kinematics
from pipeline.mesh import stage as mesh
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
