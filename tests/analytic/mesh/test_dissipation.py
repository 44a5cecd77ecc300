"""What the terms take from flows of which it is known, on a mesh of the shipped kind."""

import numpy as np
import pytest

from pipeline.formats.records import POWER_TERMS
from pipeline.openfoam.polymesh_files import read_faces
from pipeline.solve.power import _boundary_velocity, _gradient, face_terms, geometry_at, integrals
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


def test_the_height_of_a_cells_centre_is_the_integral_over_its_faces(mesh):
    """Gauss: z²/2 through the faces. A plane mesh has no faces at its ends."""
    if not mesh.area[:, 2].any():
        return
    through = mesh.area[:, 2] * mesh.centre[:, 2] ** 2 / 2
    moment = np.bincount(mesh.faces.owner, through, len(mesh.volume))
    moment -= np.bincount(mesh.faces.neighbour, through[: mesh.inner], len(mesh.volume))
    assert moment / mesh.volume == pytest.approx(mesh.cell_centre[:, 2], rel=1e-9)


def terms_of(mesh, gradient, pressure):
    """Terms of a flow linear in space, with its own values on all boundaries."""
    cells = len(mesh.volume)
    return face_terms(
        mesh, mesh.cell_centre @ gradient, np.full(cells, pressure),
        mesh.centre[mesh.inner :] @ gradient,
        np.zeros(len(mesh.faces.owner)), np.full(cells, 2.0), "LUST",
    )  # fmt: skip


def test_the_gradient_of_a_linear_flow_is_exact(mesh):
    wanted = np.array([[1.0, 3.0, 0.5], [2.0, -1.0, 0.2], [0.0, 0.0, 0.0]])
    flow = mesh.centre @ wanted
    gradient = _gradient(mesh, flow[: mesh.inner], flow[mesh.inner :])
    assert gradient == pytest.approx(np.tile(wanted, (len(mesh.volume), 1, 1)), abs=1e-9)


def test_a_wall_that_slides_along_still_water_is_slowed_by_the_layer_of_cells(mesh):
    """Couette flow between wall and cell: viscosity times area over distance, for 1 m/s."""
    n, faces = mesh.inner, len(mesh.faces.owner)
    still, on_wall = np.zeros((len(mesh.volume), 3)), np.zeros((faces - n, 3))
    tank = mesh.faces.patches["tank"]
    on_wall[tank.start - n : tank.stop - n, 0] = 1.0
    viscosity = np.full(len(mesh.volume), 2.0)
    terms = face_terms(mesh, still, 0 * viscosity, on_wall, np.zeros(faces), viscosity, "LUST")
    size = np.linalg.norm(mesh.area[tank], axis=1)
    apart = mesh.centre[tank] - mesh.cell_centre[mesh.faces.owner[tank]]
    distance = np.abs((apart * mesh.area[tank]).sum(1)) / size
    assert terms["viscous"].sum() == pytest.approx((2.0 * size / distance).sum(), rel=1e-9)


def test_the_boundaries_have_the_velocity_of_their_conditions(mesh):
    """The finger's own, none on the tank, and that of the water without what would leave it."""
    n, patches = mesh.inner, mesh.faces.patches
    water = np.tile([0.3, -0.2, 0.1], (len(mesh.volume), 1))
    moving = np.tile([1.0, 2.0, 0.0], (len(mesh.faces.owner), 1))
    given = _boundary_velocity(mesh, water, moving, None, 0.0)
    wanted = {"finger": [1, 2, 0], "tank": [0, 0, 0], "top": [0.3, 0, 0.1], "gap": [0.3, -0.2, 0.1]}
    assert {"finger", "tank", "top"} <= patches.keys()
    for name in wanted.keys() & patches.keys():
        part = given[patches[name].start - n : patches[name].stop - n]
        assert part == pytest.approx(np.tile(wanted[name], (len(part), 1)), abs=1e-12), name


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
