"""The real solver on tiny meshes: exact motion, invariants, parallel runs, restarts, guards."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from pipeline.formats.mesh_intervals import read_planform
from pipeline.openfoam.environment import foam_version
from pipeline.openfoam.foamfile import set_number
from pipeline.scene.scene import Scene, load_scene
from pipeline.solve import interval as solver_interval
from pipeline.solve import stage as run_stage
from pipeline.solve.checkpoint import read_progress
from piv.files.errors import StageError
from tests.cases.conftest import copy_of, force_difference, record, table
from tests.conftest import meshes_of, prepare, write_scene

pytestmark = pytest.mark.openfoam
RESUMES = foam_version() == "v1912" if shutil.which("pimpleFoam") else True  # v2306 begins again


def short_scene(
    folder: Path, kind: str = "2d", end: float = 0.04, numerics: str = "", interval: str = "0.01"
) -> Scene:
    """A fast, short stroke: large steps of the mesh in few time steps; `interval`: of writing."""
    stroke = "strokes = [{ pressure_kpa = 12.0, start = 0.002, duration = 0.06 }]"
    write_scene(folder, kind, f"[motion]\n{stroke}\nend_time = {end}\n", numerics)
    path = folder / "scene.toml"
    path.write_text(path.read_text().replace("interval = 0.01", f"interval = {interval}"))
    return prepare(load_scene(folder, "tiny"))


def vectors(path: Path) -> np.ndarray:
    """An OpenFOAM field's internal vectors or a points file, binary."""
    content = path.read_bytes()
    header = re.search(rb"\n(\d+)\n?\(", content)
    assert header
    return np.frombuffer(content, "<f8", 3 * int(header.group(1)), header.end()).reshape(-1, 3)


@pytest.fixture
def few_cells(monkeypatch):
    """Two ranks even for a few cells."""
    monkeypatch.setattr(solver_interval, "LEAST_CELLS", 100)


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """A half model, meshed but not solved."""
    return short_scene(tmp_path_factory.mktemp("prepared") / "half", "half")


def test_mesh_points_follow_the_data(solved):
    """1e-11 m: rounding of metres in double precision through a few additions."""
    (mesh,) = meshes_of(solved)
    motion, node = mesh.motion, mesh.sweep["node"].values
    for time_folder in ("0.02", "0.04"):
        points = vectors(solved.out / "case" / "interval_0" / time_folder / "polyMesh" / "points")
        wanted = motion.nodes(float(time_folder))[node]
        assert np.abs(points[:, :2] - wanted).max() < 1e-11
        assert np.abs(wanted - motion.nodes(0.0)[node]).max() > 1e-3  # and it has moved


def test_water_is_at_rest_until_the_finger_moves_and_signs_are_right(solved):
    forces, power = table(solved), table(solved, "power")
    early = np.abs(forces[forces[:, 0] <= 0.002, 1])
    assert early.max() < 1e-6 * np.abs(forces[:, 1]).max()
    first = forces[(forces[:, 0] > 0.004) & (forces[:, 0] < 0.012)]
    assert (first[:, 1] < 0).all()  # the finger accelerates towards +x, the water resists
    assert power[(power[:, 0] > 0.004) & (power[:, 0] < 0.02), 1].min() > 0  # and receives work
    balance = record(solved)["power_balance"]
    parts = sum(balance[name] for name in ("kinetic_energy", "dissipated", "closure"))
    assert balance["work"] == pytest.approx(parts)
    # The schemes take 0.39 of the work on this mesh of a few hundred columns; a wrong sign or
    # factor of two in any term would leave more than the work.
    assert 0 < balance["closure_fraction"] < 0.6
    assert balance["kinetic_energy"] > 0.3 * balance["work"]
    # continuity errors stay at the pressure solver's tolerance: the moving wall does not leak
    assert np.abs(table(solved, "history")[:, 3]).max() < 1e-5


def test_numbers_edited_by_hand_are_not_solved(prepared, solved, tmp_path):
    """They are the scene's, as the record says."""
    scene = copy_of(prepared, tmp_path / "half")
    set_number(scene.out / "case" / "interval_0", "density", "1.2")
    run_stage.run(scene, quiet=True)
    assert force_difference(scene, solved) == 0


def test_the_power_balance_names_all_terms(tmp_path):
    """Twenty instants of a stroke's begin leave 0.017 of the work, four would leave 0.034.

    Over a whole stroke it is below 0.01 at every level (docs/schemes.md).
    """
    scene = short_scene(tmp_path / "half", "half", interval="0.002")
    run_stage.run(scene, quiet=True)
    assert abs(record(scene)["power_balance"]["unexplained_fraction"]) < 0.02


@pytest.mark.usefixtures("few_cells")
def test_parallel_equals_serial_also_stopped_and_resumed(
    solved, prepared, tmp_path, capsys, stop_at
):
    parallel, stopped = (copy_of(prepared, tmp_path / name) for name in ("parallel", "stopped"))
    run_stage.run(parallel, quiet=True, ranks=2)
    assert record(parallel)["ranks"] == 2
    # both stop their pressure iterations at 0.5 % of a residual, less than 1e-3 of a force
    assert force_difference(solved, parallel) < 1e-3
    assert not list((parallel.out / "case").glob("*/*/*/wantedDisplacement*"))
    stop_at(stopped, 0.026, ranks=2)
    before = read_progress(stopped.out / "case" / "interval_0")
    earlier = run_stage.run(stopped, ranks=1)
    assert earlier == {n: before[n] for n in earlier}  # of the stopped part
    assert 0 < earlier["cpu_time"] < 2 * 1.2 * earlier["wall_time"] + 1  # logged to 10 ms
    assert "resumes with ranks = 2, not 1" in capsys.readouterr().out
    assert bool(record(stopped)["resumed"]) == RESUMES
    # early ends of the pressure's iterations; a mesh that loses its past would leave a tenth
    assert force_difference(parallel, stopped) < 1e-4


@pytest.mark.usefixtures("few_cells")
def test_a_run_stopped_again_and_again_ends_with_the_same_forces(tmp_path, capsys, stop_at):
    """Before the first checkpoint, twice after the same one, and then with more ranks."""
    # checkpoints so far apart that a late stop on a busy machine comes before the next one
    scene = short_scene(tmp_path / "straight", end=0.06, interval="0.03")
    stopped = copy_of(scene, tmp_path / "stopped")
    run_stage.run(scene, quiet=True)
    for stop in (0.006, 0.036, 0.035):
        stop_at(stopped, stop)
    case = stopped.out / "case" / "interval_0"
    before = read_progress(case)
    earlier = run_stage.run(stopped, ranks=2)
    assert earlier == {n: before[n] for n in earlier}  # of the stopped parts
    assert 0 < earlier["cpu_time"] < 1.2 * earlier["wall_time"] + 1  # logged to 10 ms
    assert "resumes with ranks = 1, not 2" in capsys.readouterr().out
    run_record, straight = record(stopped), table(scene)
    assert run_record["resumed"] == [0.03, 0.03]
    assert run_record["ranks"] == 1
    assert np.array_equal(straight, table(stopped))  # a checkpoint has all digits of the time
    # solved again from before damaged samples, as their error message says
    (case / "progress.json").unlink()
    samples = (case / "postProcessing" / "sheetSurface").iterdir()
    (max(samples, key=lambda path: float(path.name)) / "sheet.vtk").write_bytes(b"")
    run_stage.run(stopped, quiet=True)
    assert np.array_equal(straight, table(stopped))
    history = table(stopped, "history")
    assert history[:, 0] == pytest.approx(straight[:, 0])
    assert np.diff(history[:, -1]).min() >= 0  # the clocks add up
    assert run_record["continuity_max"] == pytest.approx(np.abs(history[:, 3]).max())
    assert run_record["mesh_quality"]["max_non_orthogonality_deg"] > 10


def test_a_stopped_run_of_half_the_tank_samples_the_same_sheet(tmp_path, stop_at):
    """Its gradients at the symmetry plane too, in the first step after the stop."""
    scene = short_scene(tmp_path / "straight", "half", end=0.02)
    stopped = copy_of(scene, tmp_path / "stopped")
    run_stage.run(scene, quiet=True)
    stop_at(stopped, 0.016)
    run_stage.run(stopped, quiet=True)
    assert bool(record(stopped)["resumed"]) == RESUMES
    sheets = (one.out.glob("case/**/sheet.vtk") for one in (scene, stopped))
    straight, resumed = ({path.parent.name: path.read_bytes() for path in of} for of in sheets)
    assert straight
    assert straight.keys() == resumed.keys()
    assert [time for time in straight if straight[time] != resumed[time]] == []


def test_full_and_half_models_agree(solved, tmp_path):
    full = short_scene(tmp_path / "full", "full")
    run_stage.run(full, quiet=True)
    # the same cells mirrored: the pressure solver stops in another place
    assert force_difference(solved, full) < 2e-3
    assert np.abs(table(full)[:, 3]).max() < 1e-2 * np.abs(table(solved)[:, 1]).max()


@pytest.mark.parametrize("sign", [1, -1])
def test_strokes_of_150_degrees_are_meshed_and_one_is_solved(tmp_path, sign):
    """The reach of the mesh motion, on arcs of constant curvature from a table of states."""
    s = np.linspace(0, 0.07, 40)
    rows = ["pressure_kpa,s,x,y"]
    for kpa in range(0, 31, 5):
        turn = max(np.radians(155.0) * kpa / 30, 1e-9)  # 2 % of the stroke come after its end
        radius, angle = 0.07 / turn, turn * s / 0.07
        x, y = radius * np.sin(angle), sign * radius * (1 - np.cos(angle))
        rows += [f"{kpa},{a:.9g},{b:.9g},{c:.9g}" for a, b, c in zip(s, x, y, strict=True)]
    (tmp_path / "arcs.csv").write_text("\n".join(rows) + "\n")
    more = (
        f'[motion]\nstates = "{tmp_path / "arcs.csv"}"\nend_time = 0.4\n'
        "strokes = [{ pressure_kpa = 30.0, start = 0.005, duration = 0.35 }]\n"
        "[mesh]\nmax_non_orthogonality_deg = 75.0\n"  # this stroke needs more than 65
    )
    scene = prepare(write_scene(tmp_path / "arcs", "2d", more, ', time_scheme = "Euler"'))
    bend = np.degrees(read_planform(scene.out, 0)["bend"].values)
    assert (sign * bend).max() == np.abs(bend).max() > 150
    if sign > 0:
        run_stage.run(scene, quiet=True)
        assert np.isfinite(table(scene)).all()


def test_the_error_of_a_failing_solver_has_its_last_lines(tmp_path):
    scene = short_scene(tmp_path / "broken")
    (scene.out / "case" / "interval_0" / "0" / "U").write_text("nonsense")
    with pytest.raises(StageError, match="last lines"):
        run_stage.run(scene, quiet=True)
