"""COUPLED=1 with the real solver: to its page, after a kill, on two ranks, over two meshes."""

import subprocess
import sys

import numpy as np
import pytest

from pipeline.couple import stage as coupled
from pipeline.formats.elastic_motion import FILE, read_elastic_motion
from pipeline.formats.finger_loads import read_loads
from pipeline.formats.kinematics import SCHEMA, read_kinematics
from pipeline.formats.mesh_intervals import read_intervals, read_planform
from pipeline.formats.records import MESH_QUALITY
from pipeline.mesh import stage as mesh_stage
from pipeline.mesh.intervals import divide
from pipeline.runs.run import open_run
from pipeline.scene.scene import load_scene
from pipeline.solve import interval as solver_interval
from piv.files.errors import StageError
from softfinger.make import Machine, make_stage
from tests.cases.conftest import copy_of, force_difference, killed_after, record, solving, table
from tests.conftest import CLOSING, ROOT, prepare, write_scene

pytestmark = [pytest.mark.openfoam, pytest.mark.slow]
STROKE = """
[motion]
strokes = [{ pressure_kpa = 12.0, start = 0.002, duration = 0.06 }]
end_time = 0.04
"""
COUPLED = f'{STROKE}source = "structure"\n'


def delta(scene):
    """Elastic rotations of a run."""
    return read_elastic_motion(scene.out / FILE)["delta"].values


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    write_scene(folder := tmp_path_factory.mktemp("prepared") / "scene", more=COUPLED)
    return prepare(load_scene(folder, "tiny"))


def test_water_holds_it_back_and_a_second_start_makes_nothing(tmp_path):
    """In a process of its own: a stage that forks from one that has used threads is ended.

    Its page is that of the tutorial (test_tutorials).
    """
    scene = write_scene(tmp_path / "scene", more=STROKE)
    out = scene.out / "coupled"
    words = [sys.executable, "-m", "softfinger", "run", str(scene.folder), "--level", "tiny"]
    words += ["--coupled", "-n", "1", "--until", "loads"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    loads = read_loads(out / "loads.h5")
    # the water holds back the finger that its pressure alone would bend, by several degrees
    behind = np.degrees(loads["bend_unloaded"] - loads["bend"]).values.max()
    assert behind > 3
    again = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert again.returncode == 0
    assert "kinematics:" not in again.stdout  # nothing is made twice
    # another mesh is made for the first guess of the motion, not for that of the finished run
    files = (out / "kinematics.h5", out / "run" / "kinematics.h5")
    first, last = (float(SCHEMA.read(path)["shape_bend"].max()) for path in files)
    assert last > 1.05 * first  # 1.08: the modelled water holds the finger back more
    numbers = {"motion.source": "structure", "mesh.wall_first_layer": 1.3e-3}
    make_stage(open_run(scene.folder, "tiny", numbers, out), "mesh", Machine(), quiet=True)
    assert read_planform(out, 0)["bend"].max() == first


def test_the_loads_of_the_run_make_its_motion(solved):
    """The criterion of every coupled run, in one run; on this mesh it is met ten times over."""
    file = read_elastic_motion(solved.out / FILE)
    assert file.attrs["tip_change"] < 0.0005 * solved.finger.length
    assert file.attrs["open_energy"] < 0.02
    # the quality of its meshes, not of those guessed before
    quality = MESH_QUALITY.read(solved.motion_folder / "mesh_quality.csv")
    bend = np.degrees(read_planform(solved.motion_folder, 0)["bend"].values)
    assert quality["bend_deg"].max() == pytest.approx(bend.max(), rel=1e-5)
    worst = quality["max_non_orthogonality_deg"].max()
    assert record(solved)["mesh_quality"]["max_non_orthogonality_deg"] == worst


def test_other_machines_are_refused(prepared, tmp_path):
    """The pipes at which the solver waits are on this machine, however the run was asked for."""
    (hosts := tmp_path / "hosts.txt").write_text("node01 slots=2\n")
    with pytest.raises(StageError, match=r"hosts\.txt: a coupled run takes this machine alone"):
        coupled.run(prepared, quiet=True, hosts=hosts)


def test_killed_and_resumed_it_moves_as_an_undisturbed_run(prepared, solved, tmp_path):
    killed = copy_of(prepared, tmp_path / "killed")
    with killed_after(killed, "interval_0/0.02/U"):
        pass
    subprocess.run(solving(killed), cwd=ROOT, check=True)
    assert len(record(killed)["resumed"]) == 1
    assert np.array_equal(delta(killed), delta(solved))
    assert np.array_equal(table(killed), table(solved))


def test_two_ranks_move_it_as_one(prepared, solved, tmp_path, monkeypatch):
    monkeypatch.setattr(solver_interval, "LEAST_CELLS", 100)
    scene = copy_of(prepared, tmp_path / "apart")
    coupled.run(scene, quiet=True, ranks=2)
    assert record(scene)["ranks"] == 2
    # 1e-3 of a force where the pressure iterations end at 0.5 % of a residual; it moves the finger
    assert force_difference(solved, scene) < 5e-3
    assert np.abs(delta(scene) - delta(solved)).max() < 1e-3 * np.abs(delta(solved)).max()


def test_over_two_meshes_it_moves_as_over_one(tmp_path, monkeypatch):
    """Fields are mapped to the second mesh: 3 % of the motion, as of forces in prescribed runs."""
    longer = COUPLED.replace("end_time = 0.04", "end_time = 0.07")
    one = prepare(write_scene(tmp_path / "one", more=longer))

    def in_two(deformation, count, *others):
        return divide(deformation, 2, *others)

    monkeypatch.setattr(mesh_stage, "divide", in_two)
    two = prepare(write_scene(tmp_path / "two", more=longer))
    for scene, meshes in ((one, 1), (two, 2)):
        coupled.run(scene, quiet=True)
        assert len(read_intervals(scene.motion_folder)) == meshes
    assert np.abs(delta(two) - delta(one)).max() < 0.03 * np.abs(delta(one)).max()


def test_fingers_that_touch_keep_the_gap_and_the_balance(tmp_path):
    write_scene(tmp_path / "scene", more=CLOSING, parent="pinch")
    scene = prepare(load_scene(tmp_path / "scene", "tiny"))
    coupled.run(scene, quiet=True)
    motion = read_elastic_motion(scene.out / FILE)
    force = motion["contact_force"].values
    assert force.min() == 0  # it never pulls
    assert force.max() > 0.5  # N; 1.0 at the impact
    outline = read_kinematics(scene.motion_folder / "kinematics.h5").data["shape_outline"].values
    left = -outline[..., 0].max() - scene.pinch.residual_gap
    assert 0 < left < 0.05 * scene.pinch.slowing_distance  # a tip at full speed stops there
    # as of a run without contact
    assert abs(record(scene)["power_balance"]["unexplained_fraction"]) < 0.02
