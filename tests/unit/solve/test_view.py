"""The time series for ParaView, of fields written by hand and read by VTK."""

import re
import shutil

import numpy as np
import pytest
import pyvista as pv

from pipeline.formats.mesh_intervals import read_intervals, read_sweep
from pipeline.openfoam.foamfile import binary_list, header, write_bytes, write_field
from pipeline.paraview.command import write_series
from pipeline.paraview.fields import RunFields
from pipeline.paraview.grids import X, Z
from pipeline.solve.map_fields import swept_cells
from piv.files.errors import StageError
from tests.conftest import meshes_of, prepare, write_scene

CLOSING = """[motion]
strokes = [{ pressure_kpa = 20.0, start = 0.002, duration = 0.12 }]
end_time = 0.1
[pinch]
residual_gap = 0.002
"""
TURN = 3.0  # 1/s
PRESSURE = 2.5  # m²/s²


def write_fields(scene, mesh, time: float, layout: str) -> None:
    """A solid-body turn about z and a constant pressure; `layout`: one rank, or two."""
    case, name = scene.out / "case" / mesh.interval.name, f"{time:g}"
    cells = swept_cells(mesh, time)
    centre = cells.centre[cells.column]
    velocity = TURN * np.column_stack([-centre[:, 1], centre[:, 0], np.zeros(len(centre))])
    fields = {"U": velocity, "p": np.full(len(centre), PRESSURE)}
    templates = next(folder for folder in (case / "0.orig", case / "0") if folder.exists())
    if layout == "one":
        for field, values in fields.items():
            write_field(case / name / field, templates / field, values)
        return
    members = [np.arange(0, len(centre), 2), np.arange(1, len(centre), 2)]
    head = header("labelList", "", "cellProcAddressing", binary=True)
    lists = [head + binary_list(labels) for labels in members]
    parts = {"constant/polyMesh/cellProcAddressing": lists}
    for field, values in fields.items():
        for labels in members:
            path = case / "by_hand" / field
            write_field(path, templates / field, values[labels])
            parts.setdefault(f"{name}/{field}", []).append(path.read_bytes())
    for file, contents in parts.items():
        for rank, content in enumerate(contents):
            write_bytes(case / f"processor{rank}" / file, content)
    (case / "state.json").write_text('{"ranks": 2, "mesh": 0}')


def shown(folder, part: str = "water") -> list[tuple[float, pv.UnstructuredGrid]]:
    reader = pv.get_reader(folder / f"{part}.pvd")
    series = []
    for time in reader.time_values:
        reader.set_active_time_value(time)
        series.append((time, reader.read()[0]))
    return series


@pytest.fixture(scope="module")
def closing(tmp_path_factory):
    """A quarter of a pinch in several mesh intervals: the end of each, and an overlap."""
    folder = tmp_path_factory.mktemp("view")
    scene = prepare(write_scene(folder, "quarter", CLOSING, parent="pinch"))
    meshes = meshes_of(scene)
    assert len(meshes) > 1
    layouts = ("one", "two")
    for k, mesh in enumerate(meshes):
        write_fields(scene, mesh, round(mesh.interval.end, 8), layouts[k % 2])
    # the interval before has this instant too
    write_fields(scene, meshes[1], round(meshes[1].interval.start, 8), layouts[1])
    return scene


@pytest.fixture(scope="module")
def quarter(closing, tmp_path_factory):
    folder = tmp_path_factory.mktemp("quarter")
    write_series(closing, folder, (), quiet=True)
    return folder


def test_every_instant_of_every_interval_is_shown_once(closing, quarter):
    series = shown(quarter)
    ends = [round(i.end, 8) for i in read_intervals(closing.out)]
    assert [time for time, _ in series] == [0.0, *ends]
    assert len(shown(quarter, "walls")) == len(series)
    for (time, grid), mesh in zip(series[1:], meshes_of(closing), strict=True):
        cells = swept_cells(mesh, time)
        volume = grid.compute_cell_sizes(length=False, area=False)["Volume"]
        # faces of VTK's hexahedra are no planes
        np.testing.assert_allclose(volume, cells.volume, rtol=1e-3)
        assert grid.volume == pytest.approx(cells.volume.sum(), rel=1e-5)


def test_velocity_pressure_and_vorticity_are_those_of_the_run(closing, quarter):
    start, *later = (grid for _, grid in shown(quarter))
    assert not np.any(start["velocity"])
    assert not np.any(start["q"])
    for grid in later:
        x, y, _ = grid.cell_centers().points.T
        size = TURN * np.hypot(x, y).max()
        # float32; VTK's cell centres are means of corners, the run's are centroids
        np.testing.assert_allclose(grid["velocity"][:, 0], -TURN * y, atol=2e-3 * size)
        np.testing.assert_allclose(grid["velocity"][:, 1], TURN * x, atol=2e-3 * size)
        np.testing.assert_allclose(grid["pressure"], PRESSURE * closing.fluid.density, rtol=1e-6)
        # VTK takes gradients from means at corners, which are not exact on coarse cells
        middle = float(np.median(grid["vorticity"][:, 2])) / (2 * TURN)
        assert 0.85 < middle < 1.15, middle
        turning = float(np.median(grid["q"])) / TURN**2  # of a solid body there is no strain
        assert 0.85**2 < turning < 1.15**2, turning


def test_the_walls_are_the_finger_where_it_is_then(closing, quarter):
    series = shown(quarter, "walls")[1:]
    for (time, grid), mesh in zip(series, meshes_of(closing), strict=True):
        outline = mesh.motion.nodes(time)[mesh.planform["wall"].values]
        np.testing.assert_allclose(grid.bounds[:4:2], outline.min(axis=0), atol=1e-6)
        np.testing.assert_allclose(grid.bounds[1:4:2], outline.max(axis=0), atol=1e-6)
        assert grid["pressure"] == pytest.approx(PRESSURE * closing.fluid.density)


def test_the_whole_tank_is_the_quarter_and_its_images(closing, quarter, tmp_path):
    write_series(closing, tmp_path, (Z, X), quiet=True)
    for (_, part), (_, tank) in zip(shown(quarter), shown(tmp_path), strict=True):
        assert tank.n_cells == 4 * part.n_cells
        assert tank.volume == pytest.approx(4 * part.volume, rel=1e-6)
        volume = tank.compute_cell_sizes(length=False, area=False)["Volume"]
        assert (volume > 0).all()  # images are not turned inside out
        first, last = np.array(tank.bounds).reshape(3, 2).T
        np.testing.assert_allclose(first, -last * [1, 0, 1], atol=1e-6)
        signs = {
            "velocity": [[1, 1, 1], [1, 1, -1], [-1, 1, 1], [-1, 1, -1]],
            "vorticity": [[1, 1, 1], [-1, -1, 1], [1, -1, -1], [-1, 1, -1]],  # an axial vector
        }
        for name, sign in signs.items():
            images = tank[name].reshape(4, -1, 3)
            np.testing.assert_array_equal(images, np.array(sign)[:, None] * part[name])


def test_between_two_instants_values_are_linear_in_the_cells_as_they_move(closing):
    fields = RunFields(closing)
    end = fields.instants[1].time
    (late, _), (half, walls) = (fields.grids(time) for time in (end, end / 2))
    np.testing.assert_allclose(half["velocity"], late["velocity"] / 2, atol=1e-6)
    first = meshes_of(closing)[0]
    outline = first.motion.nodes(end / 2)[first.planform["wall"].values]
    np.testing.assert_allclose(walls.bounds[:4:2], outline.min(axis=0), atol=1e-6)
    x0, x1, y0, y1 = walls.bounds[:4]
    near, _ = fields.grids(end, (x0, x1, y0, y1, -1.0, 1.0))
    assert 0 < near.n_cells < late.n_cells


def test_only_missing_and_old_files_are_written(closing, quarter, tmp_path):
    quarter = shutil.copytree(quarter, tmp_path / "own")
    files = sorted(quarter.glob("*.vtu"))
    before = {path: path.stat().st_mtime_ns for path in files}
    files[0].unlink()
    (quarter / "water_00099.vtu").touch()
    write_series(closing, quarter, (), quiet=True)
    assert sorted(quarter.glob("*.vtu")) == files
    again = [path for path in files if path.stat().st_mtime_ns != before[path]]
    assert {re.sub(r"\D", "", path.name) for path in again} == {re.sub(r"\D", "", files[0].name)}


def test_without_a_run_the_error_names_the_remedy(tiny, tmp_path):
    remedy = r"no run has written its fields.*make tiny\.view LEVEL=tiny"
    with pytest.raises(StageError, match=remedy):
        write_series(tiny, tmp_path, (), quiet=True)
    assert not list(tmp_path.glob("*.pvd"))
    prepare(tiny)
    with pytest.raises(StageError, match="no run has written its fields"):
        write_series(tiny, tmp_path, (), quiet=True)
    assert read_sweep(tiny.out, "interval_0").sizes["cell"] > 0  # its case is there
