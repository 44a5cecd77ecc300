"""The comparison from dpiv.toml to the page: vectors of every kind, and a recording."""

import shutil

import h5py
import numpy as np
import pytest

from fileio.errors import StageError
from fileio.formats.plane_series import write_plane
from fileio.formats.records import RUN
from pipeline.scene.scene import load_scene
from postprocess.evidence.stage_files import StageFiles
from postprocess.lab.data.dpiv_toml import read_dpiv
from postprocess.lab.data.files import LabFiles
from postprocess.lab.data.pose import Pose, camera_series
from postprocess.lab.judgement.compare import run_comparison
from postprocess.lab.registration.step import run_registration
from postprocess.lab.report.report import make_report
from postprocess.lab.virtual.virtual_laboratory import make_recording, write_dpiv
from tests.lab_exports import KINDS, exported
from tests.lab_scene import CASE, finger_kinematics, set_up, vortex_series

INPUTS = 'format = "inputs"\nformat_version = 1\ntoo_uncertain = 0.3\n'
TIMES = np.linspace(0.0, 0.42, 43)
SPACING = 2e-3


@pytest.fixture(scope="module")
def finger(tmp_path_factory):
    """A scene's files, its kinematics, and a simulation whose flow is an analytic vortex."""
    case = tmp_path_factory.mktemp("whole") / "cases" / "finger"
    out = case / "out" / "smoke"
    for folder in (case / "reference", out / "run"):
        folder.mkdir(parents=True)
    vortices = "[vortices]\nstencil_radius = 0.004\n"
    (case / "scene.toml").write_text(f'extends = "{CASE}"\n{vortices}')
    (case / "reference" / "inputs.toml").write_text(INPUTS)
    RUN.write(out / "run" / "run.json", {})
    kinematics = finger_kinematics(out)
    files = StageFiles(load_scene(case, "smoke"))
    return files, kinematics, vortex_series(kinematics, TIMES, spacing=SPACING)


def measured_by(kinematics, gain: float, corner: tuple[float, float]):
    """Vectors (100 Hz, 2 mm apart) of a vortex `gain` times as strong, and the finger's root (mm).

    In axes whose lower left vector is at `corner` (m).
    """
    pose = Pose(1.0, 0.0, kinematics.root, (0.065, 0.105))
    x, y = SPACING * np.arange(1, 76), SPACING * np.arange(1, 62)
    water = vortex_series(kinematics, TIMES, gain=gain, spacing=SPACING)
    plane = camera_series(water, pose, x, y, 0.05 + np.arange(30) / 100.0)
    plane = plane.drop_vars(["outline", "tip", "tip_direction", "dorsal_direction", "bend"])
    shift = np.array(corner) - [x[0], y[0]]
    plane = plane.assign_coords(
        x=plane["x"] + shift[0], y=plane["y"] + shift[1], time=np.arange(30) / 100.0
    )
    return plane, tuple(float(v) for v in 1e3 * (np.array(pose.at_px) + shift))


def judged(finger, folder, **options):
    """comparison.json of a folder of data."""
    files, _, sheet = finger
    dpiv = read_dpiv(folder)
    lab = LabFiles(files, dpiv.name)
    run_registration(lab, dpiv)
    left, right, bottom, top = (float(v) for v in lab.view.read_text().split())
    inside = sheet.sel(x=slice(left, right), y=slice(bottom, top))
    write_plane(inside, lab.sheet)
    return lab, run_comparison(lab, dpiv, **options)


@pytest.mark.parametrize("kind", KINDS)
def test_vectors_of_every_kind_are_compared(finger, tmp_path, kind):
    """From wherever their files count: in metres the root is in the middle of the axes."""
    corner = (
        (SPACING, SPACING)
        if "p" in KINDS[kind][2] or "px" in kind or "pivlab" in kind
        else (-0.06, -0.11)
    )
    plane, root = measured_by(finger[1], 1.0, corner)
    lab, result = judged(finger, exported(plane, kind, tmp_path / kind.replace(" ", "_"), root))
    quantities = {q["name"]: q for q in result["quantities"]}
    assert result["verdict"] == "agrees", result["wrong"]
    assert abs(quantities["circulation"]["error"][0]) < 0.02 * abs(
        quantities["circulation"]["data"][0]
    )
    assert np.hypot(*quantities["centre"]["error"]) < 0.3e-3
    assert "final_bend" not in quantities  # vectors do not show it
    assert lab.comparison.exists()


def test_a_bend_that_turns_back_is_refused_before_anything_is_solved(finger, tmp_path):
    """As of a coupled motion, which overshoots: a bend angle belongs to several shapes."""
    case = tmp_path / "cases" / "finger"
    shutil.copytree(finger[0].scene_folder, case)
    path = case / "out" / "smoke" / "kinematics.h5"
    with h5py.File(path, "r+") as file:
        file["shape_bend"][-1] = 0.9 * file["shape_bend"][-2]
    plane, root = measured_by(finger[1], 1.0, (-0.06, -0.11))
    dpiv = read_dpiv(exported(plane, "microvec", tmp_path / "back", root))
    with pytest.raises(StageError, match=r"kinematics\.h5: shape_bend neither rises nor falls"):
        run_registration(LabFiles(StageFiles(load_scene(case, "smoke")), dpiv.name), dpiv)


def test_vectors_of_a_stronger_vortex_are_told(finger, tmp_path):
    plane, root = measured_by(finger[1], 1.25, (-0.06, -0.11))
    lab, result = judged(finger, exported(plane, "microvec", tmp_path / "stronger", root))
    assert result["verdict"] == "model error"
    assert "circulation" in result["wrong"]
    page = make_report(lab).read_text()
    first = page[page.index('id="answer"') : page.index("</header>")]
    assert "Motion: not tested. Flow: no." in first
    assert "Vectors do not show the finger" in first
    assert "Circulation of the tip vortex" in first


def test_virtual_camera_is_put_before_the_vectors(finger, tmp_path):
    """Vectors whose files count from the middle of the picture."""
    plane, root = measured_by(finger[1], 1.0, (-0.06, -0.11))
    plane = plane.isel(time=slice(8, 16)).assign_coords(time=np.arange(8) / 100.0)
    folder = exported(plane, "microvec", tmp_path / "seen", root)
    text = (folder / "dpiv.toml").read_text()
    camera = (
        "{ columns = 640, rows = 520, density_ppp = 0.05, diameter_px = 2.5, background = 8.0,"
        " read_noise = 2.0, peak = 150.0, scale_mm_per_px = 0.25 }"
    )
    text = text.replace('camera = "none"', f"camera = {camera}").replace(
        "at_s = 0.05", "at_s = 0.13"
    )
    text = text.replace("window = 24", "window = 16")
    (folder / "dpiv.toml").write_text(text)
    files, _, sheet = finger
    dpiv = read_dpiv(folder)
    lab = LabFiles(files, dpiv.name)
    run_registration(lab, dpiv)
    write_plane(sheet, lab.sheet)

    result = run_comparison(lab, dpiv)
    quantities = {q["name"]: q for q in result["quantities"]}
    assert quantities["velocity_field"]["verdict"] != "model error"
    # 0.04 %; 10 % where only the virtual experiment smooths
    assert abs(quantities["circulation"]["error"][0]) < 0.03 * abs(
        quantities["circulation"]["data"][0]
    )


def test_recording_is_compared(finger, tmp_path):
    """A recording with errors of set-up."""
    _, kinematics, sheet = finger
    lab = set_up(kinematics, start=0.007)
    make_recording(sheet, lab, kinematics.root, tmp_path, 50.0)
    write_dpiv(lab, kinematics.root, tmp_path, "finger", 50.0)
    lab, result = judged(finger, tmp_path)
    assert result["verdict"] == "agrees", result["wrong"]
    quantities = {q["name"]: q for q in result["quantities"]}
    assert quantities["final_bend"]["verdict"] == "agrees"
    assert abs(result["registration"]["delay_ms"] + 7.0) < 3.0
    page = make_report(lab).read_text()
    first = page[page.index('id="answer"') : page.index("</header>")]
    assert "Motion: yes. Flow: yes." in first
    assert "Not in u_val" not in first  # no runs are asked for here
    figures = {p.name for p in (lab.folder / "figures").iterdir()}
    assert {"motion.pdf", "motion.svg", "picture.png", "series.svg"} <= figures
