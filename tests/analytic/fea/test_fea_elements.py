"""The unit cell's finite elements against closed forms: pressurised cylinder, cantilever."""

import felupe
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.sparse.linalg import spsolve

from pipeline.fea.cell.elements import follower_pressure, solid_body
from pipeline.fea.settings import Material

MU = 1e5
# K / μ = 5000 stands for incompressible: the radius differs from K = ∞ by some 1e-4.
BULK = 5000 * MU
NEO_HOOKE = Material(law="neo_hooke", parameters={"mu": MU}, bulk=BULK)
# In plane strain I1 = I2, so that Mooney–Rivlin is neo-Hooke with μ = 2 (C10 + C01).
C10_C01 = {"C10": 0.4 * MU, "C01": 0.1 * MU}
MOONEY_RIVLIN = Material(law="mooney_rivlin", parameters=C10_C01, bulk=BULK)


def box(cells, size):
    """Mesh of 20-node hexahedra of a box at the origin."""
    mesh = felupe.Cube(n=tuple(n + 1 for n in cells)).add_midpoints_edges()
    return felupe.Mesh(mesh.points * size, mesh.cells, "hexahedron20")


def newton(body, held, load, steps=4, pressure=None):
    """Displacements under a dead load (n, 3) or a follower pressure, raised in steps."""
    n = body.field[0].values.size
    free = np.setdiff1d(np.arange(n), held)
    values = np.zeros(n)
    for step in range(1, steps + 1):
        for _ in range(25):
            body.field[0].values[:] = values.reshape(-1, 3)
            force = body.assemble.vector(body.field).toarray()[:, 0] - load * step / steps
            matrix = body.assemble.matrix(body.field)
            if pressure is not None:
                surface, top = pressure
                surface.field[0].values[:] = values.reshape(-1, 3)
                force -= surface.assemble.vector(surface.field, top * step / steps).toarray()[:, 0]
                matrix = matrix - surface.assemble.matrix(surface.field, top * step / steps)
            change = spsolve(matrix.tocsr()[free][:, free].tocsc(), -force[free])
            values[free] += change
            if np.abs(change).max() < 1e-12:
                break
        else:
            pytest.fail("Newton's method did not converge")
    return values.reshape(-1, 3)


def inflated_radius(pressure, inner, outer):
    """Inner radius of an incompressible neo-Hookean tube in plane strain."""

    def excess(a):
        k = a**2 - inner**2
        b = np.sqrt(outer**2 + k)
        return MU * (np.log(outer * a / (inner * b)) + k / 2 * (1 / a**2 - 1 / b**2)) - pressure

    return brentq(excess, inner, 4 * inner)


@pytest.mark.parametrize("material", [NEO_HOOKE, MOONEY_RIVLIN], ids=["neo-Hooke", "Mooney-Rivlin"])
def test_thick_walled_cylinder_under_pressure(material):
    inner, outer, pressure = 0.010, 0.020, 0.35 * MU
    mesh = box((4, 4, 1), (1, 1, 0.003))
    radius, angle = inner + (outer - inner) * mesh.points[:, 0], np.pi / 2 * mesh.points[:, 1]
    places = np.stack([radius * np.cos(angle), radius * np.sin(angle), mesh.points[:, 2]], -1)
    tube = felupe.Mesh(places, mesh.cells, "hexahedron20")
    body = solid_body(tube, np.ones(tube.ncells, dtype=bool), material)
    held = np.zeros(places.shape, dtype=bool)
    held[:, 2] = True
    held[mesh.points[:, 1] == 1, 0] = True
    held[mesh.points[:, 1] == 0, 1] = True
    inside = mesh.points[:, 0] == 0
    load = follower_pressure(tube, inside), pressure
    moved = places + newton(body, np.flatnonzero(held), np.zeros(held.size), pressure=load)
    radii = np.linalg.norm(moved[inside, :2], axis=1)
    closed = inflated_radius(pressure, inner, outer)
    assert closed > 1.25 * inner  # the strains are large
    # 1 % of the displacement is allowed; quadratic elements reach about 0.1 %.
    np.testing.assert_allclose(radii - inner, closed - inner, rtol=0.01)


def test_cantilever_does_not_lock():
    length, height, width = 0.040, 0.002, 0.002
    bulk = 50 * MU  # as Dragon Skin: K / μ = 50
    mesh = box((10, 1, 1), (length, height, width))
    material = Material(law="neo_hooke", parameters={"mu": MU}, bulk=bulk)
    body = solid_body(mesh, np.ones(mesh.ncells, dtype=bool), material)
    x, y, _ = mesh.points.T
    held = np.zeros(mesh.points.shape, dtype=bool)
    held[x == 0, 0] = True  # the clamp lets the section contract
    held[(x == 0) & (y == 0), 1] = True
    held[mesh.points[:, 2] == 0, 2] = True
    end = x == length
    young = 9 * bulk * MU / (3 * bulk + MU)
    # 1 % of the length: small
    force = 0.01 * length * 3 * young * width * height**3 / 12 / length**3
    load = np.zeros(mesh.points.shape)
    load[end, 1] = force / end.sum()
    moved = newton(body, np.flatnonzero(held), load.ravel(), steps=1)
    shear = 1.2 * force * length / (MU * width * height)  # Timoshenko; 0.2 % here
    closed = force * length**3 / (3 * young * width * height**3 / 12) + shear
    # one element over the height: a locking element would be out by tens of per cent
    assert moved[end, 1].mean() == pytest.approx(closed, rel=0.02)
