"""The unit cell against CalculiX: the same mesh, law and pressure give the same displacements."""

import shutil
import subprocess

import numpy as np
import pytest

from pipeline.fea.cell.path import follow
from pipeline.fea.cell.unit_cell import UnitCell
from tests.finger_cell import ACTUATOR, FEA

# P1 to P6 of CalculiX's C3D20R, by the corners of the element
FACES = [[0, 1, 2, 3], [4, 7, 6, 5], [0, 4, 5, 1], [1, 5, 6, 2], [2, 6, 7, 3], [3, 7, 4, 0]]


def deck(cell, state):
    """Input file: the plane in the middle of the gap is moved as in `state`."""
    grid, cells = cell.grid, cell.grid.mesh.cells + 1
    c, s = np.cos(state.plane_angle), np.sin(state.plane_angle)
    plane = np.flatnonzero(grid.plane)
    shift = state.plane_shift * c + cell.points[plane, 1] * s
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{i}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(cell.points, 1)]
    for layer, chosen in (("lower", grid.lower), ("upper", ~grid.lower)):
        material = getattr(ACTUATOR.materials, layer)
        lines.append(f"*ELEMENT, TYPE=C3D20R, ELSET={layer}")
        for i in np.flatnonzero(chosen):
            lines += [f"{i + 1}, {', '.join(map(str, cells[i, :10]))},"]
            lines += [", ".join(map(str, cells[i, 10:]))]
        numbers = material.number("C10"), material.number("C01"), 2 / material.bulk
        lines += [f"*MATERIAL, NAME={layer}", "*HYPERELASTIC, MOONEY-RIVLIN"]
        lines += [", ".join(f"{number:.9e}" for number in numbers)]
        lines += [f"*SOLID SECTION, ELSET={layer}, MATERIAL={layer}"]
    lines += ["*NSET, NSET=PLANE", *(f"{i}," for i in plane + 1)]
    lines += [f"*TRANSFORM, NSET=PLANE, TYPE=R\n{c:.12e}, {-s:.12e}, 0., {s:.12e}, {c:.12e}, 0."]
    lines += ["*BOUNDARY", *(f"{i}, 1, 1" for i in np.flatnonzero(grid.middle) + 1)]
    lines += [f"{i}, 3, 3" for i in np.flatnonzero(grid.symmetry) + 1]
    lines += [f"{grid.ventral[0] + 1}, 2, 2"]
    lines += ["*STEP, NLGEOM, INC=500\n*STATIC\n0.05, 1., 1e-5, 0.1"]
    # CalculiX's tangent lacks part of the follower pressure: it needs many iterations
    lines += ["*CONTROLS, PARAMETERS=TIME INCREMENTATION\n8, 20, 9, 100, 60, 4, , 5", "*BOUNDARY"]
    lines += [f"{i}, 1, 1, {value:.12e}" for i, value in zip(plane + 1, shift, strict=True)]
    wet = np.argwhere(grid.cavity[grid.mesh.cells[:, FACES]].all(-1)) + 1
    lines += ["*DLOAD", *(f"{element}, P{face}, {state.pressure}" for element, face in wet)]
    return "\n".join([*lines, "*NODE FILE, FREQUENCY=500", "U", "*END STEP", ""])


@pytest.mark.skipif(shutil.which("ccx") is None, reason="needs apt-get install calculix-ccx")
def test_calculix_finds_the_same_displacements(tmp_path):
    cell = UnitCell(ACTUATOR, FEA.mesh)
    state = follow(cell, [20e3])[20e3]
    (tmp_path / "cell.inp").write_text(deck(cell, state))
    subprocess.run(["ccx", "cell"], cwd=tmp_path, check=True, stdout=subprocess.DEVNULL)
    result = (tmp_path / "cell.frd").read_text().rpartition(" DISP ")[2]
    rows = [line for line in result.splitlines() if line.startswith(" -1")]
    # fixed columns of the .frd format: manual of CalculiX CrunchiX
    found = np.array([[float(row[i : i + 12]) for i in (13, 25, 37)] for row in rows])
    expected = cell.displacement(state)
    # CalculiX ends its iterations at a residual of 0.5 % of the mean force
    np.testing.assert_allclose(found, expected, atol=3e-3 * np.abs(expected).max())
