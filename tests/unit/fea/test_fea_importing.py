"""The user's own results: a bar bent to circles gives its radii back in every format."""

import contextlib
import runpy
import sys
from types import ModuleType, SimpleNamespace

import meshio
import numpy as np
import pytest
import pyvista

from pipeline.fea.engines import imported
from pipeline.fea.settings import Import
from piv.files.errors import StageError
from tests.conftest import ROOT

PRESSURES_KPA = [-20.0, -10.0, 10.0, 20.0, 30.0]
RADII = np.array([-0.040, -0.080, 0.080, 0.040, 0.030])
LENGTH, HEIGHT, WIDTH = 0.070, 0.0145, 0.028


def bar():
    """Nodes of a bar along x, ventral surface at y = 0, sheet at z = 0, and its hexahedra."""
    lines = np.linspace(0, LENGTH, 61), [0.0, -HEIGHT / 2, -HEIGHT], [0.0, WIDTH / 2]
    points = np.stack([axis.ravel() for axis in np.meshgrid(*lines, indexing="ij")], -1)
    number = np.arange(len(points)).reshape(61, 3, 2)
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    corners = [number[i : i + 60, j : j + 2, k : k + 1] for k in (0, 1) for i, j in square]
    return points, np.stack(corners, -1).reshape(-1, 8)


def bent(points, radius):
    """Displacements that bend the ventral line to a circle of `radius` towards +y."""
    x, y, z = points.T
    angle, around = x / radius, radius - y
    return np.stack([around * np.sin(angle), radius - around * np.cos(angle), z], -1) - points


POINTS, CELLS = bar()
FIELDS = [bent(POINTS, radius) for radius in RADII]


def save(path, cells, points, values):
    grid = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: cells}, points)
    grid.point_data["displacement"] = values
    grid.save(path)


def write_vtu(folder):
    for k, values in enumerate(FIELDS):
        save(folder / f"state_{k}.vtu", CELLS, POINTS, values)
    return Import(file="state_*.vtu", pressures_kpa=PRESSURES_KPA)


def write_pvd(folder):
    write_vtu(folder)
    line = '<DataSet timestep="{}" part="0" file="state_{}.vtu"/>'
    sets = "".join(line.format(p, k) for k, p in enumerate(PRESSURES_KPA))
    kind = 'type="Collection" version="0.1"'
    text = f'<?xml version="1.0"?><VTKFile {kind}><Collection>{sets}</Collection></VTKFile>'
    (folder / "bar.pvd").write_text(text)
    return Import(file="bar.pvd")


def write_xdmf(folder):
    # meshio puts the heavy data into the current folder
    with contextlib.chdir(folder), meshio.xdmf.TimeSeriesWriter("bar.xdmf") as writer:
        writer.write_points_cells(POINTS, [("hexahedron", CELLS)])
        for pressure, values in zip(PRESSURES_KPA, FIELDS, strict=True):
            writer.write_data(pressure, point_data={"displacement": values})
    return Import(file="bar.xdmf")


def write_nodes(folder):
    """In mm, with a profile that the file names."""
    rows = ["pressure_kpa,instance,node,x,y,z,u1,u2,u3,profile"]
    for pressure, values in zip(PRESSURES_KPA, FIELDS, strict=True):
        for i, (p, u) in enumerate(zip(POINTS, values, strict=True)):
            numbers = ",".join(f"{v:.9f}" for v in (*(1e3 * p), *(1e3 * u)))
            rows.append(f"{pressure},BAR-1,{10 + i},{numbers},{int(p[1] == p[2] == 0)}")
    (folder / "nodes.csv").write_text("\n".join(rows) + "\n")
    return Import(file="nodes.csv", unit="mm")


def write_profiles(folder):
    rows = ["# digitised by hand", "pressure_kpa, s, x, y"]
    for pressure, radius in zip(PRESSURES_KPA, RADII, strict=True):
        for s in np.linspace(0, LENGTH, 61):
            x, y = radius * np.sin(s / radius), radius * (1 - np.cos(s / radius))
            rows.append(f"{pressure}, {s:.9f}, {x:.9f}, {y:.9f}")
    (folder / "profiles.csv").write_text("\n".join(rows) + "\n")
    return Import(file="profiles.csv", thickness=HEIGHT)


WRITERS = [write_vtu, write_pvd, write_xdmf, write_nodes, write_profiles]


@pytest.mark.parametrize("writer", WRITERS, ids=lambda writer: writer.__name__[6:])
def test_radii_come_back(tmp_path, writer):
    states = imported(tmp_path, writer(tmp_path), WIDTH)
    np.testing.assert_allclose(states.pressure, 1e3 * np.array(PRESSURES_KPA))
    np.testing.assert_allclose(states.radius, RADII, rtol=1e-6)
    # heights above chords of the circle
    np.testing.assert_allclose(states.thickness, HEIGHT, rtol=2e-3)
    np.testing.assert_allclose(states.profile[:, 0], 0, atol=1e-9)


@pytest.mark.parametrize(
    "writer, update, old, new, words",
    [
        (write_nodes, {"unit": "m"}, "", "", r"nodes\.csv: .*70 m long.*unit"),
        (write_nodes, {}, "\n20.0,BAR-1,33,", "\n20.0,A,33,", "node 33 .* 20 kPa"),
        (write_nodes, {}, "\n20.0,BAR-1,33,", "\n20.0,BAR-1,34,", "node 33 .* 20 kPa"),
        (write_nodes, {}, ",u1", ",ux", "no column u1 in its header"),
        (write_nodes, {"pressures_kpa": [1.0, 2.0, 3.0]}, "", "", "5 states but .* has 3"),
        (
            write_profiles,
            {},
            ", s, x, y",
            ", s, converged, x, y",
            "line 3: .* 4 cells, the",
        ),
        (
            write_profiles,
            {},
            "10.0, 0.000000000, 0.000000000",
            "10.0, 0, nan",
            "column x: 'nan' is not",
        ),
        (write_profiles, {}, "-20.0, 0.000000000, 0.000000000, ", "-20.0; 0.0; ", "line 3"),
        (write_profiles, {"thickness": 0.05}, "", "", r"-20 kPa the outline .* crosses itself"),
        (write_profiles, {"thickness": None}, "", "", "no column thickness"),
        (write_profiles, {"file": "nothing.vtu"}, "", "", r"nothing\.vtu: no such file"),
    ],
)
def test_faults_are_named(tmp_path, writer, update, old, new, words):
    results = writer(tmp_path)
    path = tmp_path / results.file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises((ValueError, StageError), match=words):
        imported(tmp_path, Import(**results.model_dump() | update), WIDTH)


def test_states_of_different_meshes_or_that_did_not_converge_are_named(tmp_path):
    results = write_vtu(tmp_path)
    save(tmp_path / "state_3.vtu", CELLS[:3], POINTS[:200], FIELDS[0][:200])
    with pytest.raises(ValueError, match="state 4 has 200 nodes, the first one 366"):
        imported(tmp_path, results, WIDTH)
    rows = ["pressure_kpa, s, x, y, converged", "10, 0, 0, 0, 1", "30, 0, 0, 0, 0"]
    (tmp_path / "profiles.csv").write_text("\n".join(rows))
    with pytest.raises(ValueError, match=r"line 3: the state at 30 kPa did not converge"):
        imported(tmp_path, Import(file="profiles.csv", thickness=HEIGHT), WIDTH)


def test_the_export_script_writes_what_is_imported(tmp_path, monkeypatch):
    """Against a stand-in for Abaqus' own modules."""
    names = [SimpleNamespace(instanceName="BAR-1", label=i) for i in range(len(POINTS))]
    for node, place in zip(names, POINTS, strict=True):
        node.coordinates = tuple(place)
    body = SimpleNamespace(name="BAR-1", nodes=names)
    profile = [node for node in names if node.coordinates[1:] == (0.0, 0.0)]

    def frame(share, radius, double):
        values = []
        for node, u in zip(names, bent(POINTS, radius), strict=True):
            value = SimpleNamespace(instance=body, nodeLabel=node.label, precision="single")
            value.data, value.dataDouble = (None, u) if double else (u.astype(np.float32), None)
            value.precision = "double" if double else "single"
            values.append(value)
        values.append(SimpleNamespace(instance=None))
        fields = {"U": SimpleNamespace(values=values)}
        return SimpleNamespace(frameValue=2 * share, fieldOutputs=fields)

    frames = [frame(0.25, 0.08, False), frame(0.5, 0.04, True), frame(1.0, 0.03, True)]
    sets = {"LOWER": SimpleNamespace(nodes=(profile,))}
    assembly = SimpleNamespace(instances={"BAR-1": body}, nodeSets=sets)
    steps = {"Inflate": SimpleNamespace(timePeriod=2.0, frames=frames)}
    odb = SimpleNamespace(steps=steps, rootAssembly=assembly, close=lambda: None)
    access, constants = ModuleType("odbAccess"), ModuleType("abaqusConstants")
    access.openOdb = lambda path, readOnly: odb
    constants.DOUBLE_PRECISION = "double"
    monkeypatch.setitem(sys.modules, "odbAccess", access)
    monkeypatch.setitem(sys.modules, "abaqusConstants", constants)
    target = tmp_path / "nodes.csv"
    monkeypatch.setattr(sys, "argv", ["x", "job.odb", "Inflate", "20", str(target), "LOWER"])
    runpy.run_path(str(ROOT / "docs" / "abaqus_export.py"), run_name="__main__")
    states = imported(tmp_path, Import(file="nodes.csv"), WIDTH)
    np.testing.assert_allclose(states.pressure, [5e3, 10e3, 20e3])
    np.testing.assert_allclose(states.radius, [0.08, 0.04, 0.03], rtol=1e-5)


def test_a_ventral_axis_of_the_wrong_sign_is_refused(tmp_path):
    """It passed as a finger 0.016 mm thick that bends by −110°, and the mesh failed later."""
    results = write_nodes(tmp_path).model_copy(update={"ventral": "-y"})
    with pytest.raises(ValueError, match=r"profile lies on the side of the chambers.*other sign"):
        imported(tmp_path, results, WIDTH)
    results = write_vtu(tmp_path).model_copy(update={"ventral": "-y"})
    with pytest.raises(ValueError, match=r"bends by -\d+°, against the ventral side"):
        imported(tmp_path, results, WIDTH)
    results = write_profiles(tmp_path).model_copy(update={"thickness": 1.6e-5})
    with pytest.raises(ValueError, match=r"0\.016 mm thick and .* as no finger is"):
        imported(tmp_path, results, WIDTH)
