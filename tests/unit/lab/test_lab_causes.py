"""Pressure, structure and flow told apart, where the pressure in the chambers was measured."""

import numpy as np
import pytest

from fileio.errors import StageError
from fileio.formats.elastic_motion import write_elastic_motion
from fileio.formats.finger_loads import write_loads
from fileio.formats.recorded_motion import write_recorded_motion
from fileio.formats.records import LAB_COMPARISON
from pipeline.scene.scene import load_scene
from pipeline.study.couple import Structure
from postprocess.evidence.stage_files import StageFiles
from postprocess.lab.data.dpiv_toml import read_dpiv
from postprocess.lab.data.files import NO_NUISANCE, LabFiles, Law, Registration, write_registration
from postprocess.lab.data.pose import Pose
from postprocess.lab.judgement.causes import causes, sentences, write_scene
from tests.lab_scene import CASE, finger_kinematics
from tests.unit.lab.test_lab_dpiv import WHOLE, written

DELAY = 0.1  # s, of the simulation's clock after the recording's
TIME = np.linspace(0.0, 0.42, 43)
PRESSURE = '\npressure = { csv = "p.csv", std_kpa = 0.1 }\n'


@pytest.fixture
def lab(tmp_path):
    """A scene, and a recording of it: p.csv is the scene's own pressure."""
    case = tmp_path / "finger"
    (case / "reference").mkdir(parents=True)
    (case / "scene.toml").write_text(f'extends = "{CASE}"\n')
    (case / "reference" / "inputs.toml").write_text(
        'format = "inputs"\nformat_version = 1\ntoo_uncertain = 0.3\n'
    )
    (case / "out" / "smoke").mkdir(parents=True)
    kinematics = finger_kinematics(case / "out" / "smoke")
    data = tmp_path / "run7"
    data.mkdir()
    text = WHOLE.replace('"nominal"', '"measured"') + PRESSURE
    with pytest.raises(ValueError, match=r"pressure is on the camera's clock, .* give start = "):
        read_dpiv(written(data, text))
    stated = f"start = {{ at_s = {-DELAY}, std_s = 0.001 }}"
    dpiv = read_dpiv(written(data, text.replace('start = "from motion"', stated)))
    pressure_csv(data, kinematics, 1.0)
    files = LabFiles(StageFiles(case, "smoke"), dpiv.name)
    files.folder.mkdir(parents=True)
    pose, turn = Pose(1.25e-4, 0.0, kinematics.root, (640.0, 950.0)), np.radians(0.05)
    law = Law(np.array([1.0, DELAY, 1.0]), np.diag([1e-3, 1e-3, 1e-3]) ** 2, 1.0)
    covariance = np.diag([0.1, 0.1, turn, 1e-3]) ** 2
    none = np.empty(0)
    write_registration(
        Registration(pose, covariance, NO_NUISANCE, law, none, none, none, pose),
        files.registration,
        dpiv_sha256="0",
        seed=1,
        view=pose.view((0.0, 0.0), (1280.0, 1024.0), 0.0),
    )
    return files, dpiv, kinematics


def pressure_csv(folder, kinematics, factor):
    time = np.linspace(-0.02, 0.45, 48)
    p = factor * kinematics.law(np.clip(time, *kinematics.time))
    rows = [f"{t + DELAY:.6g},{value:.6g}" for t, value in zip(time, p, strict=True)]
    (folder / "p.csv").write_text("t,p\n" + "\n".join(rows) + "\n")


def moved(files, kinematics, recorded_by, coupled_by):
    """The recorded motion, and a coupled run, each so many rad beside the scene's bend."""
    bend = kinematics.bend(kinematics.law(TIME))
    still = {name: np.zeros((3, 4)) for name in ("profile_x", "profile_y", "thickness")}
    write_recorded_motion(
        files.motion,
        still
        | {"time": TIME, "pressure": 0 * TIME, "bend": bend + recorded_by, "state_pressure": np.arange(3.0)}
        | {"seen": TIME, "seen_bend": bend + recorded_by, "seen_radius": 1 + TIME, "seen_residual": 0 * TIME}
        | {"recording": "r", "dpiv_sha256": "0", "registration": "{}"},
    )
    run = files.folder / "pressure" / "out" / "coupled" / "smoke_2"
    (run / "out" / "smoke").mkdir(parents=True, exist_ok=True)
    write_loads(run / "out" / "smoke", {"step": TIME, "bend": bend + coupled_by, "unknown": ""}, {})
    motion = {"time": TIME, "pressure": 0 * TIME, "delta": np.zeros((43, 2)), "knot": np.arange(3.0)}
    write_elastic_motion(
        run / "elastic_motion.h5", still | motion | {"made_of": "", "tip_change": 1e-4, "bend_change": 2e-3}
    )


def test_the_scene_has_the_measured_pressure_on_the_simulations_clock(lab):
    files, dpiv, kinematics = lab
    scene = load_scene(write_scene(files, dpiv), "smoke")
    assert scene.motion.strokes == ()
    structure = Structure(scene)  # what COUPLED=1 makes of it
    # linear between samples 10 ms apart, against 20 kPa
    assert np.abs(structure.pressure - kinematics.law(structure.time)).max() < 100


@pytest.mark.parametrize(
    "factor, recorded_by, coupled_by, words",
    [
        (1.0, 0.0, 0.001, ("agrees", "agrees")),
        (1.1, 0.1, 0.101, ("differs", "agrees")),  # another pressure explains the motion
        (1.0, 0.0, 0.1, ("agrees", "model error")),  # at the same pressure it moves otherwise
    ],
)
def test_causes_are_told_apart(lab, factor, recorded_by, coupled_by, words):
    files, dpiv, kinematics = lab
    pressure_csv(dpiv.folder, kinematics, factor)
    write_scene(files, dpiv)
    moved(files, kinematics, recorded_by, coupled_by)
    table = causes(files, dpiv).set_index("cause")
    assert (table.verdict["pressure"], table.verdict["structure"], table.verdict["flow"]) == (
        *words,
        "not judged",
    )
    assert (files.folder / "causes.csv").exists()


def test_a_large_uncertainty_hides_the_answer(lab):
    files, dpiv, kinematics = lab
    write_scene(files, dpiv)
    moved(files, kinematics, 0.0, 0.1)
    text = (dpiv.folder / "dpiv.toml").read_text().replace("std_kpa = 0.1", "std_kpa = 5.0")
    table = causes(files, read_dpiv(written(dpiv.folder, text)))
    assert list(table.verdict) == ["too uncertain", "too uncertain", "not judged"]


def test_the_flow_is_that_of_the_measured_motion(lab):
    files, dpiv, kinematics = lab
    write_scene(files, dpiv)
    moved(files, kinematics, 0.0, 0.0)
    judged = files.folder / "measured" / "out" / "smoke" / "lab" / dpiv.name / "comparison.json"
    judged.parent.mkdir(parents=True)
    LAB_COMPARISON.write(judged, {"flow": "model error"})
    told = sentences(causes(files, dpiv))
    assert told[2] == "flow: model error, with the recording's own motion"


def test_what_is_missing_is_told(lab):
    files, dpiv, kinematics = lab
    write_scene(files, dpiv)
    moved(files, kinematics, 0.0, 0.0)
    (files.folder / "pressure" / "out" / "coupled" / "smoke_2" / "out" / "smoke" / "loads.h5").unlink()
    with pytest.raises(StageError, match="holds no coupled run of level smoke; make compare-coupled"):
        causes(files, dpiv)
    bare = read_dpiv(written(dpiv.folder, WHOLE))
    with pytest.raises(StageError, match=r"says no pressure; give pressure = \{ csv = "):
        write_scene(files, bare)
    (dpiv.folder / "p.csv").write_text("t,p\n0.1,0\n0.2,1e3\n0.3,2e3\n")
    with pytest.raises(StageError, match="must reach from the motion's begin to its end"):
        write_scene(files, dpiv)
