"""The water's force on a wall, from a sampled surface as OpenFOAM v1912 writes it."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.openfoam.surface_vtk import wall_forces
from pipeline.solve.power import finger_power, power_rows

DENSITY = 998.0  # kg/m³
A, B, C = 0.02, 0.03, 0.05  # m, sides of a box
FACES = [  # corners counter-clockwise as seen from inside: OpenFOAM's normals leave the water
    [0, 1, 2, 3], [4, 7, 6, 5], [0, 4, 5, 1], [3, 2, 6], [3, 6, 7], [0, 3, 7, 4], [1, 5, 6, 2],
]  # fmt: skip
OUT = np.array([[0, 0, -1], [0, 0, 1], [0, -1, 0], [0, 1, 0], [0, 1, 0], [-1, 0, 0], [1, 0, 0]])
AREA = np.array([A * B, A * B, A * C, A * C / 2, A * C / 2, B * C, B * C])  # m²


def write_surface(path, pressure, shear, velocity):
    """A box of sides A, B, C whose wall has kinematic pressure, `wallShearStress` and U by face."""
    corners = [
        (0, 0, 0),
        (1, 0, 0),
        (1, 1, 0),
        (0, 1, 0),
        (0, 0, 1),
        (1, 0, 1),
        (1, 1, 1),
        (0, 1, 1),
    ]
    points = np.array(corners) * [A, B, C] + [0.4, 0.1, 0.0]
    polygons = np.concatenate([[len(face), *face] for face in FACES])
    content = b"# vtk DataFile Version 2.0\nwall\nBINARY\nDATASET POLYDATA\n"
    content += b"POINTS 8 float\n" + points.astype(">f4").tobytes() + b"\n"
    content += f"POLYGONS {len(FACES)} {polygons.size}\n".encode()
    content += polygons.astype(">i4").tobytes() + b"\n"
    content += f"CELL_DATA {len(FACES)}\nFIELD attributes 3\n".encode()
    for name, values in (("p", pressure), ("wallShearStress", shear), ("U", velocity)):
        table = np.asarray(values, ">f4").reshape(len(FACES), -1)
        content += f"{name} {table.shape[1]} {len(FACES)} float\n".encode()
        content += table.tobytes() + b"\n"
    path.write_bytes(content)
    return path


def test_pressure_pushes_inwards_and_shear_drags_along_with_the_water(tmp_path):
    """Water that streams past along +x gives wallShearStress along -x: that of wall on water."""
    pressure = 1.0 + np.arange(7.0)  # m²/s²
    shear = np.tile([-0.2, 0.0, 0.0], (7, 1))
    velocity = np.tile([0.0, 0.3, 0.0], (7, 1))
    path = write_surface(tmp_path / "wall.vtk", pressure, shear, velocity)
    centre, force, moved = wall_forces(path, DENSITY)
    wanted = DENSITY * AREA[:, None] * (-pressure[:, None] * OUT + [0.2, 0.0, 0.0])
    # single precision, of corners 0.4 m from 0 on a side of 0.02 m
    assert force == pytest.approx(wanted, abs=1e-5 * np.abs(wanted).max())
    assert centre[0] == pytest.approx([0.4 + A / 2, 0.1 + B / 2, 0.0], abs=1e-7)
    assert centre[3] == pytest.approx([0.4 + 2 * A / 3, 0.1 + B, C / 3], abs=1e-7)
    assert moved == pytest.approx(velocity)
    # the wall moves along +y: it works against the water's force
    assert finger_power(path, DENSITY) == pytest.approx(-0.3 * wanted[:, 1].sum(), rel=1e-5)


def test_the_table_of_powers_is_of_the_whole_tank(tmp_path):
    """Two computed halves; 2 S:S = 2 |grad u|² − |curl u|², and half of the latter is sampled."""
    samples = tmp_path / "postProcessing"
    table = samples / "volumes" / "0" / "volFieldValue.dat"
    surface = samples / "fingerSurface" / "0.25" / "finger.vtk"
    for path in (table, surface):
        path.parent.mkdir(parents=True)
    table.write_text("# Time\n0.25 3e-4 5.0 2.0\n")
    along = np.tile([0.0, 0.3, 0.0], (7, 1))
    write_surface(surface, 1.0 + np.arange(7.0), np.zeros((7, 3)), along)
    fluid = SimpleNamespace(density=DENSITY, kinematic_viscosity=1e-3)
    wanted = 2 * np.array([0, finger_power(surface, DENSITY), DENSITY * 1.5e-4, DENSITY * 6e-3])
    assert power_rows(tmp_path, fluid, 2) == pytest.approx(wanted[None] + [0.25, 0, 0, 0])


def test_a_uniform_pressure_pushes_a_closed_wall_nowhere(tmp_path):
    path = write_surface(tmp_path / "wall.vtk", np.ones(7), np.zeros((7, 3)), np.zeros((7, 3)))
    force = wall_forces(path, DENSITY)[1]
    assert force.sum(axis=0) == pytest.approx([0, 0, 0], abs=1e-5 * np.abs(force).max())
