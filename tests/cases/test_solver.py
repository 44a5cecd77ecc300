"""The real solver on tiny meshes: exact motion, invariants, parallel runs, restarts, guards."""

import json
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from tqdm import tqdm

from fileio.errors import StageError
from fileio.formats.mesh_intervals import read_intervals, read_planform
from fileio.formats.node_motion import read_motion
from fileio.formats.sweep import read_sweep
from pipeline.case import numbers_text
from pipeline.cost import Spent
from pipeline.openfoam.displacement_files import Steps
from pipeline.openfoam.environment import foam_version
from pipeline.openfoam.foamfile import is_complete
from pipeline.openfoam.ranks import Ranks
from pipeline.run import guards, solver
from pipeline.run import stage as run_stage
from pipeline.run.guards import Guard
from pipeline.run.prepare import prepare as lay_frames
from pipeline.run.solver import read_progress, set_number
from pipeline.scene.scene import Scene, load_scene
from tests.conftest import ROOT, prepare, write_scene

pytestmark = [
    pytest.mark.openfoam,
    pytest.mark.skipif(shutil.which("pimpleFoam") is None, reason="OpenFOAM is not installed"),
]

# A fast, short stroke: large steps of the mesh in few time steps.
SHORT = "[motion]\nstrokes = [{{ pressure_kpa = 12.0, start = 0.002, duration = 0.06 }}]\nend_time = {end}\n"
FORCES = "run/forces.csv"


def short_scene(
    folder: Path, kind: str = "2d", end: float = 0.04, numerics: str = "", more: str = ""
) -> Scene:
    return prepare(write_scene(folder, kind, SHORT.format(end=end) + more, numerics))


def copy_of(scene: Scene, folder: Path) -> Scene:
    """The same prepared scene in another folder."""
    shutil.copytree(scene.folder, folder, symlinks=True)
    return load_scene(folder, scene.level)


def table(path: Path) -> np.ndarray:
    return np.loadtxt(path, delimiter=",", skiprows=1)


def vectors(path: Path) -> np.ndarray:
    """An OpenFOAM field's internal vectors or a points file, binary."""
    content = path.read_bytes()
    header = re.search(rb"\n(\d+)\n?\(", content)
    assert header
    count = int(header.group(1))
    return np.frombuffer(content, "<f8", 3 * count, header.end()).reshape(-1, 3)


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """A half model, meshed but not solved."""
    return short_scene(tmp_path_factory.mktemp("prepared") / "half", "half")


@pytest.fixture(scope="module")
def solved(prepared, tmp_path_factory):
    """The half model, solved in one go on one rank."""
    scene = copy_of(prepared, tmp_path_factory.mktemp("solved") / "half")
    run_stage.run(scene, quiet=True)
    return scene


def test_mesh_points_follow_the_data(solved):
    """1e-11 m, from rounding of metres in double precision through a few additions."""
    motion = read_motion(solved.out)
    node = read_sweep(solved.out, "interval_0")["node"].values
    for time_folder in ("0.02", "0.04"):
        points = vectors(solved.out / "case" / "interval_0" / time_folder / "polyMesh" / "points")
        wanted = motion.nodes(float(time_folder))[node]
        assert np.abs(points[:, :2] - wanted).max() < 1e-11
        assert np.abs(wanted - motion.nodes(0.0)[node]).max() > 1e-3  # and it has moved


def test_water_is_at_rest_until_the_finger_moves_and_signs_are_right(solved):
    forces = table(solved.out / FORCES)
    early = np.abs(forces[forces[:, 0] <= 0.002, 1])
    assert early.max() < 1e-6 * np.abs(forces[:, 1]).max()
    first = forces[(forces[:, 0] > 0.004) & (forces[:, 0] < 0.012)]
    assert (first[:, 1] < 0).all()  # the finger accelerates towards +x, the water resists
    power = table(solved.out / "run" / "power.csv")
    assert (
        power[(power[:, 0] > 0.004) & (power[:, 0] < 0.02), 1].min() > 0
    )  # and takes work from it
    balance = json.loads((solved.out / "run" / "run.json").read_text())["power_balance"]
    assert balance["work"] == pytest.approx(
        balance["kinetic_energy"] + balance["dissipated"] + balance["closure"]
    )
    # work is done on the water, and what is neither kinetic energy nor resolved dissipation is lost to the schemes (0.39 of it
    # on this mesh of a few hundred columns); a wrong sign or factor of two in any term would leave more than the work
    assert 0 < balance["closure_fraction"] < 0.6
    assert balance["kinetic_energy"] > 0.3 * balance["work"]


def test_the_power_balance_is_explained_by_name(tmp_path):
    """Face by face; what is left is what the integral over twenty instants misses of a stroke that begins: 0.017 of the work.

    Over four instants it is 0.034; over those of a whole stroke below 0.01 at every level that was run (docs/schemes.md).
    """
    scene = write_scene(tmp_path / "half", "half", SHORT.format(end=0.04))
    path = scene.folder / "scene.toml"
    path.write_text(path.read_text().replace("write_interval = 0.01", "write_interval = 0.002"))
    scene = prepare(load_scene(scene.folder, "tiny"))
    run_stage.run(scene, quiet=True)
    balance = json.loads((scene.out / "run" / "run.json").read_text())["power_balance"]
    assert abs(balance["unexplained_fraction"]) < 0.02


def test_volume_is_conserved(solved):
    """Continuity errors stay at the pressure solver's tolerance: nothing leaks through the moving wall."""
    history = table(solved.out / "run" / "history.csv")
    assert np.abs(history[:, 3]).max() < 1e-5


def test_parallel_equals_serial(solved, prepared, tmp_path, monkeypatch):
    monkeypatch.setattr(run_stage, "LEAST_CELLS", 100)
    scene = copy_of(prepared, tmp_path / "parallel")
    run_stage.run(scene, quiet=True, ranks=2)
    one, two = table(solved.out / FORCES), table(scene.out / FORCES)
    # both stop their pressure iterations at 0.5 % of a residual; what is left of that in a force is below 1e-3
    assert np.abs(one[:, 1:3] - two[:, 1:3]).max() < 1e-3 * np.abs(one[:, 1:3]).max()
    assert json.loads((scene.out / "run" / "run.json").read_text())["ranks"] == 2


def test_collated_files_give_the_same_forces_to_the_last_digit(
    prepared, tmp_path, monkeypatch, capsys
):
    """One file for both ranks instead of one for each; stopped and resumed from them as well, whatever is asked for then."""
    monkeypatch.setattr(run_stage, "LEAST_CELLS", 100)
    apart, shared, stopped = (
        copy_of(prepared, tmp_path / name) for name in ("apart", "shared", "stopped")
    )
    run_stage.run(apart, quiet=True, ranks=2)
    run_stage.run(shared, quiet=True, ranks=2, collated=True)
    assert (shared.out / FORCES).read_bytes() == (apart.out / FORCES).read_bytes()
    assert json.loads((shared.out / "run" / "run.json").read_text())["collated"]
    case = shared.out / "case" / "interval_0"
    assert [p.name for p in case.glob("processor*")] == ["processors2"]
    assert not list(case.glob("*/*/wantedDisplacement*"))

    class Stop(guards.Guard):
        def verdict(self, line):
            return super().verdict(line) or ("test" if self.time >= 0.026 else None)

    with monkeypatch.context() as patch:
        patch.setattr(guards, "Guard", Stop)
        with pytest.raises(StageError, match="by a guard: test"):
            run_stage.run(stopped, quiet=True, ranks=2, collated=True)
    before = read_progress(stopped.out / "case" / "interval_0")
    earlier = run_stage.run(stopped, ranks=2)
    assert earlier == Spent(
        before["wall_time"], before["cpu_time"]
    )  # costs/ counts the parts that were stopped as well
    assert (
        0 < earlier.cpu_time < 2 * 1.2 * earlier.wall_time + 1
    )  # two ranks; CPU time is logged to 10 ms
    assert "resumes with 2 ranks and collated files, not 2 ranks" in capsys.readouterr().out
    begun_again = foam_version() != "v1912"  # resumed, v2306 goes on wrongly
    assert (
        bool(json.loads((stopped.out / "run" / "run.json").read_text())["resumed"]) != begun_again
    )
    straight, resumed = table(shared.out / FORCES), table(stopped.out / FORCES)
    # what stopping the pressure's iterations early leaves; a mesh whose past is not found again leaves a tenth
    assert np.abs(straight[:, 1:3] - resumed[:, 1:3]).max() < 1e-4 * np.abs(straight[:, 1:3]).max()


@pytest.mark.parametrize("scheme", ["backward", "Euler"])
def test_a_killed_run_resumes_and_ends_with_the_same_forces(tmp_path, scheme):
    scene = short_scene(tmp_path / "straight", end=0.06, numerics=f', time_scheme = "{scheme}"')
    killed = copy_of(scene, tmp_path / "killed")
    run_stage.run(scene, quiet=True)
    command = [
        sys.executable,
        "-m",
        "pipeline",
        "run",
        str(killed.folder),
        "--level",
        "tiny",
        "--quiet",
    ]
    process = subprocess.Popen(command, cwd=ROOT)
    checkpoint = killed.out / "case" / "interval_0" / "0.03" / "uniform" / "time"
    deadline = time.monotonic() + 600
    while not checkpoint.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)  # the solver must notice by itself that its parent is gone
    process.wait()
    time.sleep(0.5)
    if (killed.out / "run" / "run.json").exists():
        pytest.skip("the run ended before it could be killed")
    # a checkpoint that was cut off is not taken for whole
    newest = max(
        (p for p in (killed.out / "case" / "interval_0").glob("0.*/U")),
        key=lambda p: float(p.parent.name),
    )
    newest.write_bytes(newest.read_bytes()[:-400])
    assert not is_complete(newest)
    subprocess.run(command, cwd=ROOT, check=True)
    straight, resumed = table(scene.out / FORCES), table(killed.out / FORCES)
    record = json.loads((killed.out / "run" / "run.json").read_text())
    assert len(record["resumed"]) == 1
    assert straight[:, 0] == pytest.approx(resumed[:, 0])
    scale = np.abs(straight[:, 1:3]).max()
    assert np.abs(straight[:, 1:3] - resumed[:, 1:3]).max() < 1e-6 * scale


def test_a_run_stopped_again_and_again_ends_with_the_same_forces(tmp_path, monkeypatch, capsys):
    """Before the first checkpoint, twice after the same one, and at last with another number of ranks asked for."""
    monkeypatch.setattr(run_stage, "LEAST_CELLS", 100)
    # checkpoints so far apart that a stop which a busy machine makes late comes before the next one
    scene = write_scene(tmp_path / "straight", "2d", SHORT.format(end=0.06))
    text = (
        (scene.folder / "scene.toml")
        .read_text()
        .replace("write_interval = 0.01", "write_interval = 0.03")
    )
    (scene.folder / "scene.toml").write_text(text)
    scene = prepare(load_scene(scene.folder, scene.level))
    stopped = copy_of(scene, tmp_path / "stopped")
    run_stage.run(scene, quiet=True)
    for stop in (0.006, 0.036, 0.035):

        class Stop(guards.Guard):
            def verdict(self, line, stop=stop):
                return super().verdict(line) or ("test" if self.time >= stop else None)

        with monkeypatch.context() as patch:
            patch.setattr(guards, "Guard", Stop)
            with pytest.raises(StageError, match="by a guard: test"):
                run_stage.run(stopped, quiet=True)
    before = read_progress(stopped.out / "case" / "interval_0")
    earlier = run_stage.run(stopped, ranks=2)
    assert earlier == Spent(
        before["wall_time"], before["cpu_time"]
    )  # costs/ counts the parts that were stopped as well
    assert (
        0 < earlier.cpu_time < 1.2 * earlier.wall_time + 1
    )  # one rank; CPU time is logged to 10 ms
    assert "resumes with 1 ranks, not 2 ranks" in capsys.readouterr().out
    record = json.loads((stopped.out / "run" / "run.json").read_text())
    assert record["resumed"] == [0.03, 0.03]
    assert record["ranks"] == 1
    straight, resumed = table(scene.out / FORCES), table(stopped.out / FORCES)
    assert np.array_equal(
        straight, resumed
    )  # to the last digit: it starts where it stood, with all digits of the time
    # solved again from before damaged samples, as the error for them says: the frames of the motion are laid anew
    case = stopped.out / "case" / "interval_0"
    (case / "progress.json").unlink()
    sampled = sorted(
        (case / "postProcessing" / "sheetSurface").iterdir(), key=lambda path: float(path.name)
    )
    (sampled[-1] / "sheet.vtk").write_bytes(b"")
    run_stage.run(stopped, quiet=True)
    assert np.array_equal(straight, table(stopped.out / FORCES))
    history = table(stopped.out / "run" / "history.csv")
    assert history[:, 0] == pytest.approx(straight[:, 0])
    assert np.diff(history[:, -1]).min() >= 0  # the clocks add up
    assert record["continuity_max"] == pytest.approx(np.abs(history[:, 3]).max())
    assert record["mesh_quality"]["max_non_orthogonality_deg"] > 10


def test_a_stopped_run_of_half_the_tank_samples_the_same_sheet(tmp_path, monkeypatch):
    """Its gradients at the symmetry plane too, in the first step after the stop."""
    scene = short_scene(tmp_path / "straight", "half", end=0.02)
    stopped = copy_of(scene, tmp_path / "stopped")
    run_stage.run(scene, quiet=True)

    class Stop(guards.Guard):
        def verdict(self, line):
            return super().verdict(line) or ("test" if self.time >= 0.016 else None)

    with monkeypatch.context() as patch:
        patch.setattr(guards, "Guard", Stop)
        with pytest.raises(StageError, match="by a guard: test"):
            run_stage.run(stopped, quiet=True)
    run_stage.run(stopped, quiet=True)
    resumed = json.loads((stopped.out / "run" / "run.json").read_text())["resumed"]
    assert bool(resumed) == (
        foam_version() == "v1912"
    )  # others begin again: resumed, v2306 goes on wrongly
    sheets = [
        one.out / "case" / "interval_0" / "postProcessing" / "sheetSurface"
        for one in (scene, stopped)
    ]
    times = sorted(path.name for path in sheets[0].iterdir())
    assert sorted(path.name for path in sheets[1].iterdir()) == times
    differ = [
        t
        for t in times
        if (sheets[0] / t / "sheet.vtk").read_bytes() != (sheets[1] / t / "sheet.vtk").read_bytes()
    ]
    assert differ == []


def test_a_uniform_stream_stays_uniform_on_the_moving_mesh(tmp_path):
    """The finger made transparent: every boundary lets a uniform stream through, and only the mesh moves."""
    scene = short_scene(tmp_path / "stream", end=0.02)
    case = scene.out / "case" / "interval_0"
    velocity = (case / "0" / "U").read_text()
    velocity = velocity.replace("uniform (0 0 0);\n\nboundary", "uniform (0.3 0.1 0);\n\nboundary")
    velocity, count = re.subn(
        r"""("[^"]*(?:finger|tank)[^"]*"|top)( +)\{[^}]*\}""",
        r"\1\2{ type fixedValue; value uniform (0.3 0.1 0); }",
        velocity,
    )
    assert count == 3
    velocity = re.sub(r"gap( +)\{[^}]*\}", r"gap\1{ type zeroGradient; }", velocity)
    (case / "0" / "U").write_text(velocity)
    intervals = read_intervals(scene.out)
    lay_frames(
        scene.out,
        intervals,
        intervals[0],
        Ranks(),
        Steps.of(0.0, 0.02, scene.numerics.time_step),
        quiet=True,
    )
    text = (case / "system" / "fvSolution").read_text()
    text = re.sub(
        r"(relTol +)[\d.]+;", r"\g<1>0;", re.sub(r"(tolerance +)[\de.-]+;", r"\g<1>1e-12;", text)
    )
    (case / "system" / "fvSolution").write_text(text)
    with tqdm(total=1.0, disable=True) as bar:
        solver.solve(
            case, intervals[0], Ranks(), None, bar,
            Guard(scene.numerics.max_courant),
        )  # fmt: skip
    field = vectors(case / "0.02" / "U")
    assert (
        np.abs(field - [0.3, 0.1, 0.0]).max() < 1e-8
    )  # the linear solvers' tolerance, 1e-12, times their steps


def test_full_and_half_models_agree(solved, tmp_path):
    full = short_scene(tmp_path / "full", "full")
    run_stage.run(full, quiet=True)
    one, two = table(solved.out / FORCES), table(full.out / FORCES)
    # the same cells mirrored: what differs is where the pressure solver stops
    assert np.abs(one[:, 1:3] - two[:, 1:3]).max() < 2e-3 * np.abs(one[:, 1:3]).max()
    assert np.abs(two[:, 3]).max() < 1e-2 * np.abs(one[:, 1]).max()


@pytest.mark.parametrize("sign", [1, -1])
def test_strokes_of_150_degrees_run(tmp_path, sign):
    """The reach of the mesh motion: 0…150° and −150…0°, on arcs of constant curvature given as a table of states."""
    s = np.linspace(0, 0.07, 40)
    rows = ["pressure_kpa,s,x,y"]
    for kpa in range(0, 31, 5):
        turn = max(
            np.radians(155.0) * kpa / 30, 1e-9
        )  # 2 % of the stroke are still to come at its end
        x, y = (
            np.sin(turn * s / 0.07) * 0.07 / turn,
            sign * (1 - np.cos(turn * s / 0.07)) * 0.07 / turn,
        )
        rows += [f"{kpa},{a:.9g},{b:.9g},{c:.9g}" for a, b, c in zip(s, x, y, strict=True)]
    (tmp_path / "arcs.csv").write_text("\n".join(rows) + "\n")
    more = (
        f'[motion]\nstates = "{tmp_path / "arcs.csv"}"\nend_time = 0.4\n'
        "strokes = [{ pressure_kpa = 30.0, start = 0.005, duration = 0.35 }]\n"
        "[mesh]\nmax_non_orthogonality_deg = 75.0\n"  # 65 holds over the default stroke, not over this one
    )
    scene = prepare(write_scene(tmp_path / "arcs", "2d", more, ', time_scheme = "Euler"'))
    bend = np.degrees(read_planform(scene.out, 0)["bend"].values)
    assert np.abs(bend).max() > 150
    assert np.sign(bend[np.abs(bend).argmax()]) == sign
    run_stage.run(scene, quiet=True)
    assert np.isfinite(table(scene.out / FORCES)).all()


def test_a_guard_stops_the_run_and_keeps_the_files(tmp_path):
    scene = short_scene(tmp_path / "fast", numerics=", max_courant = 1.55")
    with pytest.raises(StageError, match=r"stopped at .* by a guard: Courant number"):
        run_stage.run(scene, quiet=True)
    assert (scene.out / "case" / "interval_0" / "log.pimpleFoam").stat().st_size > 0
    assert not (scene.out / "run" / "run.json").exists()


def test_a_failing_solver_shows_its_last_lines(tmp_path):
    scene = short_scene(tmp_path / "broken")
    (scene.out / "case" / "interval_0" / "0" / "U").write_text("nonsense")
    with pytest.raises(StageError, match="last lines"):
        run_stage.run(scene, quiet=True)


def test_the_shipped_base_case_is_complete():
    """An expert can read it: every number it names is in its own system/numbers."""
    base = ROOT / "cases" / "_base"
    names = set(
        re.findall(r"\$(\w+)", "\n".join(p.read_text() for p in base.rglob("*") if p.is_file()))
    ) - {"p"}
    defined = set(re.findall(r"(?m)^(\w+)\s", (base / "system" / "numbers").read_text()))
    assert names == defined
    assert "timeStep" in numbers_text({"timeStep": "1"})
    with pytest.raises(StageError, match="occurs 0 times"):
        set_number(base, "noSuchNumber", "1")
