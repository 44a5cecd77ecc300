"""The swept mesh: cells that close, volumes that add up, OpenFOAM's order."""

import numpy as np
import pytest

from pipeline.case.interval_case import build_mesh
from pipeline.formats.mesh_intervals import read_planform
from tests.conftest import prepare, write_scene


def face_vectors(mesh, points):
    """Area vectors of all faces (triangles and planar quads)."""
    size = np.diff(mesh.face_offset)
    first = mesh.face_offset[:-1]
    corner = np.array([mesh.face_points[first + np.minimum(k, size - 1)] for k in range(4)])
    a, b, c, d = points[corner]
    return 0.5 * np.cross(c - a, d - b), 0.25 * (a + b + c + np.where((size == 4)[:, None], d, 0.0))


@pytest.mark.parametrize("kind", ["2d", "half", "full"])
def test_cells_close_and_fill_tank_minus_finger(tmp_path, kind):
    scene = prepare(write_scene(tmp_path / kind, kind))
    planform = read_planform(scene.out, 0)
    mesh = build_mesh(planform)
    nodes, levels = planform["points"].values[-1], planform["levels"].values
    points = mesh.points(nodes, levels)
    area, _ = face_vectors(mesh, points)
    # last corner repeated for triangles: (c - a) x (c - b) / 2 is the triangle's area vector
    cells = len(mesh.cell_column)
    closed = np.zeros((cells, 3))
    np.add.at(closed, mesh.owner, area)
    np.subtract.at(closed, mesh.neighbour, area[: len(mesh.neighbour)])
    assert np.abs(closed).max() < 1e-16  # areas up to 1e-3 m², rounding 1e-16
    # divergence theorem with F = (0, 0, z): volume of each cell from its faces in the levels
    z = points[mesh.face_points[mesh.face_offset[:-1]], 2]
    flux = area[:, 2] * z
    volume = np.zeros(cells)
    np.add.at(volume, mesh.owner, flux)
    np.subtract.at(volume, mesh.neighbour, flux[: len(mesh.neighbour)])
    assert volume.min() > 0
    wall = nodes[planform["wall"].values]
    body = 0.5 * np.sum(wall[:, 0] * np.roll(wall[:, 1], -1) - np.roll(wall[:, 0], -1) * wall[:, 1])
    depth = levels[-1] - levels[0]
    width = min(scene.finger.width, depth) if kind != "half" else 0.5 * scene.finger.width
    exact = 0.6 * 0.3 * depth - body * width
    assert volume.sum() == pytest.approx(exact, rel=1e-12)


def test_openfoams_order(tmp_path):
    scene = prepare(write_scene(tmp_path / "s", "half"))
    mesh = build_mesh(read_planform(scene.out, 0))
    inner = len(mesh.neighbour)
    assert (mesh.owner[:inner] < mesh.neighbour).all()
    pair = np.column_stack([mesh.owner[:inner], mesh.neighbour])
    assert (np.lexsort((pair[:, 1], pair[:, 0])) == np.arange(inner)).all()
    start = inner
    for _, first, count in mesh.patches:
        assert first == start
        start += count
    assert start == len(mesh.owner)
    names = {name for name, _, _ in mesh.patches}
    assert names == {"finger", "tank", "top", "gap", "back", "sheet"}
