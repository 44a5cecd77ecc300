"""The user's own results: a bar bent exactly to circles, in every format, gives its radii back; faults are named."""

import contextlib

import meshio
import numpy as np
import pytest
import pyvista

from fileio.errors import StageError
from pipeline.fea.engines import imported
from pipeline.fea.settings import Import

PRESSURES_KPA = [-20.0, -10.0, 10.0, 20.0, 30.0]
RADII = np.array([-0.040, -0.080, 0.080, 0.040, 0.030])
LENGTH, HEIGHT, WIDTH = 0.070, 0.0145, 0.028
# Profiles are chords between 61 points: at R = 30 mm their sagitta is 6e-6 m, 2e-4 of R. Nodes lie on the circle.
RTOL = 1e-6


def bar():
    """Nodes of a bar along x, ventral surface at y = 0, sheet at z = 0, and its hexahedra."""
    grid = np.meshgrid(
        np.linspace(0, LENGTH, 61), [0.0, -HEIGHT / 2, -HEIGHT], [0.0, WIDTH / 2], indexing="ij"
    )
    points = np.stack([axis.ravel() for axis in grid], -1)
    number = np.arange(len(points)).reshape(61, 3, 2)
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
    cells = np.stack([number[i : i + 60, j : j + 2, k : k + 1] for i, j, k in corners], -1).reshape(
        -1, 8
    )
    return points, cells


def bent(points, radius):
    """Displacements that bend the ventral line to a circle of `radius` towards +y."""
    x, y, _ = points.T
    angle = x / radius
    moved = np.stack(
        [(radius - y) * np.sin(angle), radius - (radius - y) * np.cos(angle), points[:, 2]], -1
    )
    return moved - points


POINTS, CELLS = bar()
FIELDS = [bent(POINTS, radius) for radius in RADII]


def write_vtu(folder):
    for k, values in enumerate(FIELDS):
        grid = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: CELLS}, POINTS)
        grid.point_data["displacement"] = values
        grid.save(folder / f"state_{k}.vtu")
    return Import(file="state_*.vtu", pressures_kpa=PRESSURES_KPA)


def write_pvd(folder):
    write_vtu(folder)
    sets = "".join(
        f'<DataSet timestep="{p}" part="0" file="state_{k}.vtu"/>'
        for k, p in enumerate(PRESSURES_KPA)
    )
    text = f'<?xml version="1.0"?><VTKFile type="Collection" version="0.1"><Collection>{sets}</Collection></VTKFile>'
    (folder / "bar.pvd").write_text(text)
    return Import(file="bar.pvd")


def write_xdmf(folder):
    # meshio puts the heavy data into the current folder
    with contextlib.chdir(folder), meshio.xdmf.TimeSeriesWriter("bar.xdmf") as writer:
        writer.write_points_cells(POINTS, [("hexahedron", CELLS)])
        for pressure, values in zip(PRESSURES_KPA, FIELDS, strict=True):
            writer.write_data(pressure, point_data={"displacement": values})
    return Import(file="bar.xdmf")


def write_abaqus(folder):
    """In mm; the part lies elsewhere than its instance, which is moved and turned by 90° about z."""
    part = np.stack([POINTS[:, 1], -POINTS[:, 0], POINTS[:, 2]], -1) * 1e3 - [5.0, 7.0, 0.0]
    nodes = "\n".join(f"{10 + i}, {p[0]:.9f}, {p[1]:.9f}, {p[2]:.9f}" for i, p in enumerate(part))
    line = [10 + i for i, p in enumerate(POINTS) if p[1] == 0 and p[2] == 0]
    text = f"*Heading\n** a comment\n*Part, name=Bar\n*Node\n{nodes}\n*End Part\n*Assembly, name=A\n*Instance, name=Bar-1, part=Bar\n"
    text += "5., 7., 0.\n0., 0., 0., 0., 0., 1., 90.\n*End Instance\n*Nset, nset=profile, instance=Bar-1\n"
    text += (
        ",\n".join(", ".join(map(str, line[k : k + 8])) for k in range(0, len(line), 8))
        + "\n*End Assembly\n"
    )
    (folder / "bar.inp").write_text(text)
    rows = ["pressure_kpa,instance,node,u1,u2,u3"]
    for pressure, values in zip(PRESSURES_KPA, FIELDS, strict=True):
        rows += [
            f"{pressure},BAR-1,{10 + i},{u[0]:.9f},{u[1]:.9f},{u[2]:.9f}"
            for i, u in enumerate(values * 1e3)
        ]
    (folder / "u.csv").write_text("\n".join(rows) + "\n")
    return Import(file="bar.inp", displacements="u.csv", unit="mm", node_set="PROFILE")


def write_frd(folder):
    lines = ["    1C", f"    2C{len(POINTS):30d}{1:38d}"]
    lines += [
        f" -1{i + 1:10d}{p[0]:12.5E}{p[1]:12.5E}{p[2]:12.5E}" for i, p in enumerate(POINTS)
    ] + [" -3"]
    for k, values in enumerate(FIELDS):
        lines += [
            f"  100CL  101{(k + 1) / len(FIELDS):12.5E}{len(POINTS):12d}",
            " -4  DISP        4    1",
        ]
        lines += [" -5  D1          1    2    1    0"]
        lines += [
            f" -1{i + 1:10d}{u[0]:12.5E}{u[1]:12.5E}{u[2]:12.5E}" for i, u in enumerate(values)
        ] + [" -3"]
    (folder / "bar.frd").write_text("\n".join([*lines, " 9999"]) + "\n")
    return Import(file="bar.frd", pressures_kpa=PRESSURES_KPA)


def write_profiles(folder):
    rows = ["# digitised by hand", "pressure_kpa, s, x, y"]
    s = np.linspace(0, LENGTH, 61)
    for pressure, radius in zip(PRESSURES_KPA, RADII, strict=True):
        x, y = radius * np.sin(s / radius), radius * (1 - np.cos(s / radius))
        rows += [f"{pressure}, {a:.9f}, {b:.9f}, {c:.9f}" for a, b, c in zip(s, x, y, strict=True)]
    (folder / "profiles.csv").write_text("\n".join(rows) + "\n")
    return Import(file="profiles.csv", thickness=HEIGHT)


WRITERS = [write_vtu, write_pvd, write_xdmf, write_abaqus, write_frd, write_profiles]


@pytest.mark.parametrize("writer", WRITERS, ids=lambda writer: writer.__name__[6:])
def test_radii_come_back(tmp_path, writer):
    states = imported(tmp_path, writer(tmp_path), WIDTH)
    np.testing.assert_allclose(states.pressure, 1e3 * np.array(PRESSURES_KPA))
    # an .frd has six digits: 5e-8 m of 0.07 m, hence up to 3e-5 of the flattest radius
    np.testing.assert_allclose(states.radius, RADII, rtol=3e-5 if writer is write_frd else RTOL)
    np.testing.assert_allclose(
        states.thickness, HEIGHT, rtol=2e-3
    )  # heights above chords of the circle
    np.testing.assert_allclose(states.profile[:, 0], 0, atol=1e-9)


def change(path, old, new, count=1):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))


def test_metres_taken_for_millimetres(tmp_path):
    given = write_abaqus(tmp_path).model_copy(update={"unit": "m"})
    with pytest.raises(ValueError, match=r"bar\.inp.*70 m long.*unit"):
        imported(tmp_path, given, WIDTH)


def test_missing_node(tmp_path):
    given = write_abaqus(tmp_path)
    lines = (tmp_path / "u.csv").read_text().splitlines()
    (tmp_path / "u.csv").write_text(
        "\n".join(line for line in lines if not line.startswith("20.0,BAR-1,33,"))
    )
    with pytest.raises(ValueError, match=r"u\.csv: 1 of 366 nodes, first 33.*20 kPa"):
        imported(tmp_path, given, WIDTH)


def test_label_that_the_model_does_not_have(tmp_path):
    given = write_abaqus(tmp_path)
    change(tmp_path / "u.csv", "BAR-1,33,", "BAR-1,9999,")
    with pytest.raises(ValueError, match=r"node 9999 .* is not in bar\.inp"):
        imported(tmp_path, given, WIDTH)


def test_unknown_node_set(tmp_path):
    given = write_abaqus(tmp_path).model_copy(update={"node_set": "BELLY"})
    with pytest.raises(ValueError, match=r"BELLY.*PROFILE"):
        imported(tmp_path, given, WIDTH)


def test_counts_that_do_not_match(tmp_path):
    given = write_vtu(tmp_path)
    pyvista.Plane().save(tmp_path / "other.vtp")
    grid = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: CELLS[:3]}, POINTS[:200])
    grid.point_data["displacement"] = FIELDS[0][:200]
    grid.save(tmp_path / "state_3.vtu")
    with pytest.raises(ValueError, match="state 4 has 200 nodes, the first one 366"):
        imported(tmp_path, given, WIDTH)


def test_number_of_pressures(tmp_path):
    given = write_frd(tmp_path).model_copy(update={"pressures_kpa": [1.0, 2.0, 3.0]})
    with pytest.raises(ValueError, match="5 states but pressures_kpa has 3"):
        imported(tmp_path, given, WIDTH)


def test_run_that_was_cut_short(tmp_path):
    given = write_frd(tmp_path)
    text = (tmp_path / "bar.frd").read_text()
    (tmp_path / "bar.frd").write_text(text[: text.rindex(" -3")])
    with pytest.raises(ValueError, match="ends within a block of displacements"):
        imported(tmp_path, given, WIDTH)


def test_state_that_did_not_converge(tmp_path):
    given = write_profiles(tmp_path)
    text = (tmp_path / "profiles.csv").read_text().replace("s, x, y", "s, x, y, converged")
    lines = [
        line + (", 0" if line.startswith("30.0") else ", 1") if line[0] in "-123" else line
        for line in text.splitlines()
    ]
    (tmp_path / "profiles.csv").write_text("\n".join(lines))
    with pytest.raises(ValueError, match=r"line 247.*30 kPa did not converge"):
        imported(tmp_path, given, WIDTH)


def test_not_a_number(tmp_path):
    given = write_profiles(tmp_path)
    change(tmp_path / "profiles.csv", "10.0, 0.000000000, 0.000000000", "10.0, 0.000000000, nan")
    with pytest.raises(ValueError, match="not numbers"):
        imported(tmp_path, given, WIDTH)


def test_broken_line_is_named(tmp_path):
    given = write_profiles(tmp_path)
    change(tmp_path / "profiles.csv", "-20.0, 0.000000000, 0.000000000, ", "-20.0; 0.0; ")
    with pytest.raises(ValueError, match="line 3"):
        imported(tmp_path, given, WIDTH)


def test_outline_that_crosses_itself(tmp_path):
    given = write_profiles(tmp_path).model_copy(update={"thickness": 0.050})  # more than R = 40 mm
    with pytest.raises(ValueError, match=r"-20 kPa the outline .* crosses itself"):
        imported(tmp_path, given, WIDTH)


def test_file_that_is_not_there(tmp_path):
    with pytest.raises(StageError, match=r"nothing\.frd: no such file"):
        imported(tmp_path, Import(file="nothing.frd"), WIDTH)
