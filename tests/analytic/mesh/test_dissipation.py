"""What the terms take from flows of which it is known, on a mesh of the shipped kind."""

import numpy as np
import pytest

from pipeline.formats.records import POWER_TERMS
from pipeline.openfoam.polymesh_files import read_faces
from pipeline.solve.power import face_terms, geometry_at, integrals
from tests.conftest import meshes_of, prepare, write_scene


@pytest.fixture(scope="module", params=["2d", "half"])
def mesh(request, tmp_path_factory):
    scene = prepare(write_scene(tmp_path_factory.mktemp("terms") / "s", request.param))
    faces = read_faces(scene.out / "case" / "interval_0" / "constant" / "polyMesh")
    return geometry_at(faces, meshes_of(scene)[0], 0.0)


def test_faces_close_every_cell_and_bound_its_volume(mesh):
    for sign, cells in ((1, mesh.faces.owner), (-1, mesh.faces.neighbour)):
        assert cells.max() < len(mesh.volume), sign
    through = mesh.area * mesh.centre  # the divergence of each coordinate is 1
    for axis in range(3 if mesh.area[:, 2].any() else 2):
        volume = np.bincount(mesh.faces.owner, through[:, axis], len(mesh.volume))
        volume -= np.bincount(mesh.faces.neighbour, through[: mesh.inner, axis], len(mesh.volume))
        assert volume == pytest.approx(mesh.volume, rel=1e-9)


def terms_of(mesh, gradient, pressure):
    """Terms of a flow linear in space, with its own values on all boundaries."""
    cells = len(mesh.volume)
    return face_terms(
        mesh, mesh.cell_centre @ gradient, np.full(cells, pressure),
        mesh.centre[mesh.inner :] @ gradient,
        np.zeros(len(mesh.faces.owner)), np.full(cells, 2.0), "LUST",
    )  # fmt: skip


def test_viscosity_takes_the_square_of_the_gradient(mesh):
    gradient = np.array([[1.0, 3.0, 0.0], [2.0, -1.0, 0.0], [0.0, 0.0, 0.0]])
    loss = terms_of(mesh, gradient, 0.0)["viscous"].sum()
    # the normal gradient at walls is not corrected beside triangles: 2 % here
    assert loss == pytest.approx(2.0 * (gradient**2).sum() * mesh.volume.sum(), rel=0.05)


def test_a_uniform_pressure_takes_nothing(mesh):
    gradient = np.array([[1.0, 3.0, 0.0], [2.0, -1.0, 0.0], [0.0, 0.0, 0.0]])
    loss = terms_of(mesh, gradient, 7.0)["coupling"]
    assert abs(loss.sum()) < 1e-9 * np.abs(loss).sum()


def test_a_uniform_flow_loses_nothing(mesh):
    flow = np.tile([0.3, -0.2, 0.0], (len(mesh.faces.owner), 1))
    cells = len(mesh.volume)
    pressure = np.random.default_rng(1).normal(size=cells)
    no_flux, viscosity = np.zeros(len(flow)), np.ones(cells)
    of_flow = flow[:cells], pressure, flow[mesh.inner :]
    terms = face_terms(mesh, *of_flow, no_flux, viscosity, "linearUpwind")
    assert all(np.abs(term).max() < 1e-12 for term in terms.values())


def test_energies_are_the_integrals_of_powers_from_rest():
    time = np.linspace(0.1, 1.0, 10)
    table = np.column_stack([time, *(np.tile(time, (len(POWER_TERMS.columns) - 1, 1)))])
    assert integrals(table)["viscous"] == pytest.approx(0.5, rel=1e-6)
