"""The cells named to the motion solver touch every node in every layer, and are few."""

import numpy as np
import pytest

from pipeline.case import interval_case as case
from pipeline.formats.mesh_intervals import read_planform
from pipeline.kinematics import stage as kinematics
from pipeline.mesh import stage as mesh
from pipeline.openfoam.covering_columns import covering_cells, covering_columns
from tests.conftest import write_scene


def touched(corners, column, layer, cells):
    return {(layer[c], n) for c in cells for n in corners[column[c]]}


def test_a_strip_of_triangles_needs_every_third():
    nodes = np.arange(30)
    corners = np.column_stack([nodes[:-2], nodes[1:-1], nodes[2:], nodes[2:]])
    chosen = covering_columns(corners, np.arange(len(corners)))
    assert set(corners[chosen].ravel()) == set(nodes)
    assert len(chosen) == 10


@pytest.mark.parametrize("kind", ["2d", "half", "full"])
def test_every_node_of_every_layer_is_touched_by_about_a_fifth_of_the_cells(tmp_path, kind):
    scene = write_scene(tmp_path / "scene", kind)
    kinematics.run(scene, quiet=True)
    mesh.run(scene, quiet=True)
    planform = read_planform(scene.out, 0)
    swept = case.build_mesh(planform)
    triangles = planform["triangles"].values
    corners = np.vstack([triangles[:, [0, 1, 2, 2]], planform["quads"].values])
    column, layer = swept.cell_column, swept.cell_layer
    cells = covering_cells(corners, column, layer)
    every = range(len(column))
    assert touched(corners, column, layer, cells) == touched(corners, column, layer, every)
    assert 0.15 < len(cells) / len(column) < 0.3
    _, zones = case.zones(swept, planform)
    assert sorted(np.concatenate(list(zones.values()))) == sorted(cells)
    if kind == "full":
        middle = 0.5 * (planform["levels"].values[1:] + planform["levels"].values[:-1])
        assert (middle[layer[zones["behindSheet"]]] < 0).all()
        assert (middle[layer[zones["beforeSheet"]]] > 0).all()
