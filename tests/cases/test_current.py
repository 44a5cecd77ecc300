"""A current through the tank, of the solver: exact streams, balances, and a run that resumes."""

from pathlib import Path

import numpy as np
import pytest

from docs.evidence.validation.transparent import at_end, solve_transparent
from pipeline.formats.elastic_motion import FILE, read_elastic_motion
from pipeline.formats.kinematics import read_kinematics
from pipeline.scene.current import Stream
from pipeline.scene.scene import Scene
from pipeline.solve import stage as run_stage
from pipeline.structure.finger import ElasticFinger
from tests.cases.conftest import copy_of, record, table
from tests.conftest import prepare, write_scene
from tests.conftest import run_stage as run_stage_of

pytestmark = pytest.mark.openfoam

MOVING = """
[motion]
strokes = [{ pressure_kpa = 12.0, start = 0.005, duration = 0.06 }]
end_time = 0.04
"""
RUNNING = "speed = 0.1\nlead = 0.1"


def current_scene(folder: Path, keys: str, kind: str = "2d", more: str = MOVING) -> Scene:
    return write_scene(folder, kind, f"[current]\n{keys}\n{more}")


def test_a_uniform_stream_is_exact_on_a_moving_mesh(tmp_path):
    """As the finger lets it through; 1e-12: a thousand roundings."""
    scene = current_scene(tmp_path / "s", 'speed = 0.1\nwalls = "slip"\nlead = 0.01')
    solve_transparent(scene)
    assert np.abs(at_end(scene).velocity - [0.1, 0.0]).max() < 1e-12


@pytest.mark.parametrize(
    "keys",
    ["speed = 0.05\namplitude = 0.1\nfrequency = 20.0\nramp = 0.02", 'table = "u.csv"'],
)
def test_an_accelerated_stream_follows_its_law(tmp_path, keys):
    """Triangles disturb it: by 5 % of its peak here, RMS by area; a wrong law or sign by more."""
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "u.csv").write_text("t [ms],u [cm/s]\n0,0\n10,5\n20,12\n40,20\n")
    scene = current_scene(tmp_path / "s", f'{keys}\nwalls = "slip"\ndirection = "-x"')
    solve_transparent(scene)
    stream, end = Stream.of(scene), scene.motion.end_time
    wanted, peak = float(stream.law(np.array(end))), stream.peak(end, scene.numerics.time_step)
    assert abs(wanted) > 0.3 * peak
    cells = at_end(scene)
    mean = np.average(cells.velocity, axis=0, weights=cells.areas)
    assert mean == pytest.approx([wanted, 0.0], abs=0.02 * peak)
    spread = ((cells.velocity - mean) ** 2).sum(1)
    assert np.sqrt(np.average(spread, weights=cells.areas)) < 0.08 * peak


@pytest.mark.parametrize(
    "keys, lead, mean, shape",
    [
        # half of Poiseuille's below a lid that slips; the mean of Pohlhausen's profile
        ('"boundary_layer"\nthickness = 0.3', 0.5, 0.035, lambda h: 1.5 * (2 * h - h**2)),
        ('"channel"', 1.0, 0.05, lambda h: 6 * h * (1 - h)),
    ],
)
def test_a_slow_stream_has_the_parabola_of_its_bottom_and_lid(tmp_path, keys, lead, mean, shape):
    """6 cells over the height: 2 % for their order; a bottom that slips would give 1."""
    more = f"{MOVING}\n[fluid]\nkinematic_viscosity = 0.01\n[numerics]\npressure_correctors = 4\n"
    scene = current_scene(
        tmp_path / "s", f"speed = 0.05\nlead = {lead}\nprofile = {keys}", more=more
    )
    solve_transparent(scene)
    cells = at_end(scene)
    middle = np.abs(cells.centres[:, 0] - 0.15) < 0.1
    u, height = cells.velocity[middle, 0], cells.centres[middle, 1] / scene.tank.water_depth
    assert np.average(u, weights=cells.areas[middle]) == pytest.approx(mean, rel=0.02)
    assert np.abs(u - mean * shape(height)).max() < 0.05 * 1.5 * mean


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """A half model in a current with a boundary layer, whose finger bends; not solved."""
    keys = f'{RUNNING}\nprofile = "boundary_layer"\nthickness = 0.1'
    return prepare(current_scene(tmp_path_factory.mktemp("current") / "s", keys, "half"))


def test_what_the_current_brings_is_accounted_for(solved):
    """Momentum and energy; without the work of the ends' pressure, all of it would be left."""
    assert abs(record(solved)["through_flow"]["momentum_unexplained"]) < 0.02
    balance = record(solved)["power_balance"]
    assert abs(balance["unexplained_fraction"]) < 0.03
    assert balance["from_nothing_fraction"] < 0.01
    time, inflow, outflow, *_ = table(solved, "through_flow").T
    mean = 0.3 - 0.1 + 0.7 * 0.1  # m of the depth, of Pohlhausen's profile
    # the faces beside the bottom take the profile at their middles: 25 mm of its 100 mm
    assert inflow == pytest.approx(0.1 * 0.3 * mean, rel=0.02)
    rest = time < 0.005  # then the finger swells
    # 1e-3: the pressure solver's tolerance
    assert outflow[rest] == pytest.approx(inflow[rest], rel=1e-3)


def test_the_current_pushes_the_resting_finger_and_the_walls(solved):
    """Drag coefficient of the finger of about 1 by its front; friction along the flow."""
    time, fx, *_ = table(solved).T
    finger = solved.finger
    unit = 0.5 * solved.fluid.density * 0.1**2 * finger.length * finger.width
    held = fx[(time > 0.003) & (time < 0.0055)]  # after the first steps
    assert 0.5 < held.mean() / unit < 3.0
    assert 0 < table(solved, "through_flow")[0, -1] < unit


def test_a_stopped_run_in_a_current_ends_with_the_same_forces(prepared, solved, tmp_path, stop_at):
    """Bit for bit with v1912 and one rank; the stream before 0 s is not solved again."""
    stopped = copy_of(prepared, tmp_path / "s")
    stop_at(stopped, 0.026)
    lead = stopped.out / "case" / "lead" / "log.pimpleFoam"
    before = lead.stat().st_mtime_ns
    run_stage.run(stopped, quiet=True)
    assert lead.stat().st_mtime_ns == before
    assert np.abs(table(stopped) - table(solved)).max() < 1e-6 * np.abs(table(solved)).max()


def test_a_current_bends_a_coupled_finger_its_way(tmp_path):
    """0.3 m/s push by a tenth of the pressure's moment; run and modelled water have one sign."""
    bends = {}
    for direction in ("+x", "-x"):
        keys = f'speed = 0.3\nlead = 0.1\ndirection = "{direction}"'
        more = MOVING.replace("0.04", "0.06") + 'source = "structure"\n'
        scene = prepare(current_scene(tmp_path / direction, keys, more=more))
        guessed = read_kinematics(scene.out / "kinematics.h5")
        run_stage_of(scene, "solve")
        file = read_elastic_motion(scene.out / FILE)
        chain = ElasticFinger.of(scene).chain
        bend = chain.bend(file["pressure"].values, file["delta"].values)
        bends[direction] = bend[-1], float(np.ravel(guessed.bend(np.array([0.06])))[0])
        assert abs(record(scene)["power_balance"]["unexplained_fraction"]) < 0.05
    computed, modelled = np.degrees(np.subtract(bends["+x"], bends["-x"]))
    assert computed > 0.3
    assert modelled > 0.3
