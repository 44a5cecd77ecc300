"""The comparison from dpiv.toml to the page: vectors of every kind, and a recording.

The commands are the user's; the flow of a run is an analytic vortex in place of the solver's.
"""

import h5py
import numpy as np
import pytest

from fileio.errors import StageError
from fileio.formats.kinematics import read_kinematics
from fileio.formats.plane_series import write_plane
from fileio.formats.records import LAB_COMPARISON, RUN
from pipeline.kinematics import stage as kinematics_stage
from pipeline.runs.make import Machine
from pipeline.runs.run import open_run
from postprocess.lab import command
from postprocess.lab.data.pose import Pose, camera_series
from postprocess.lab.virtual.virtual_laboratory import camera_for
from tests.lab_exports import exported
from tests.lab_scene import CASE, vortex_series

INPUTS = """format = "inputs"
format_version = 1
too_uncertain = 0.3
[[input]]
name = "pressure"
key = "motion.strokes.0.pressure_kpa"
step = 1.0
limit = 0.2
reason = "sensor"
[[numerics]]
name = "grid"
ratio = 1.5
order = 2.0
safety = 3.0
"""
TIMES = np.linspace(0.0, 0.42, 43)
SPACING = 2e-3


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run whose flow is an analytic vortex."""
    case = tmp_path_factory.mktemp("whole") / "cases" / "finger"
    (case / "reference").mkdir(parents=True)
    text = f'extends = "{CASE}"\n[vortices]\nscale = 0.004\n'
    (case / "scene.toml").write_text(text)
    (case / "reference" / "inputs.toml").write_text(INPUTS)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "make", kinematics_alone)
        patch.setattr(command, "make_sheet", analytic_sheet)
        patch.setattr(command, "camera_for", lambda root: camera_for(root, 400, 0.4))
        yield open_run(case, "smoke")


def kinematics_alone(run, target, machine, quiet):
    path = run.path("kinematics")
    if not path.exists():
        (run.out / "run").mkdir(parents=True)
        kinematics_stage.run(run.scene, quiet=True)
        RUN.write(run.out / "run" / "run.json", {})


def analytic_sheet(run, view, path, quiet, most=None):
    kinematics = read_kinematics(run.path("kinematics"))
    x0, x1, y0, y1 = view
    sheet = vortex_series(kinematics, TIMES, spacing=SPACING).sel(x=slice(x0, x1), y=slice(y0, y1))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_plane(sheet, path)


def measured_by(run, gain: float = 1.0, corner: tuple[float, float] = (-0.06, -0.11)):
    """Vectors (100 Hz, 2 mm apart) of a vortex `gain` times as strong, and the finger's root (mm).

    In axes whose lower left vector is at `corner` (m).
    """
    kinematics_alone(run, "run", None, True)
    kinematics = read_kinematics(run.path("kinematics"))
    pose = Pose(1e3, 0.0, kinematics.root, (0.065, 0.105))
    x, y = SPACING * np.arange(1, 76), SPACING * np.arange(1, 62)
    flow = vortex_series(kinematics, TIMES, gain=gain, spacing=SPACING)
    plane = camera_series(flow, pose, x, y, 0.05 + np.arange(30) / 100.0)
    plane = plane.drop_vars(["outline", "tip", "tip_direction", "dorsal_direction", "bend"])
    shift = np.array(corner) - [x[0], y[0]]
    at = {"x": plane["x"] + shift[0], "y": plane["y"] + shift[1], "time": np.arange(30) / 100.0}
    return plane.assign_coords(at), tuple(float(v) for v in 1e3 * (np.array(pose.at_px) + shift))


def compared(run, folder, inputs=False):
    """comparison.json of a folder of data by the name of its quantities, and the page's answer."""
    options = {"inputs": inputs, "quick": False, "quiet": True}
    page = command.compare_with(run, folder, Machine(), **options)
    result = LAB_COMPARISON.read(page.parent / "comparison.json")
    text = page.read_text()
    first = text[text.index('id="answer"') : text.index("</header>")]
    return result, {q["name"]: q for q in result["quantities"]}, first


def relative_error(quantities, name="circulation"):
    return abs(quantities[name]["error"][0] / quantities[name]["data"][0])


@pytest.mark.parametrize(
    "kind, corner",
    [("microvec", (-0.06, -0.11)), ("pivlab mat", (SPACING, SPACING)),
     ("plane in px", (SPACING, SPACING))],
)  # fmt: skip
def test_vectors_are_compared_from_wherever_their_files_count(run, tmp_path, kind, corner):
    plane, root = measured_by(run, corner=corner)
    result, quantities, _ = compared(run, exported(plane, kind, tmp_path / kind.split()[-1], root))
    assert result["verdict"] == "agrees", result["wrong"]
    assert result["missing_runs"] == ["pressure", "grid"]
    assert relative_error(quantities) < 0.02
    assert np.hypot(*quantities["centre"]["error"]) < 0.3e-3
    assert "final_bend" not in quantities  # vectors do not show it


def test_a_bend_that_turns_back_is_refused_before_anything_is_solved(run, tmp_path):
    """As of a coupled motion, which overshoots: a bend angle belongs to several shapes."""
    other = open_run(run.scene.folder, "smoke", {}, tmp_path / "other")
    folder = exported(measured_by(other)[0], "microvec", tmp_path / "back")
    with h5py.File(other.path("kinematics"), "r+") as file:
        file["shape_bend"][-1] = 0.9 * file["shape_bend"][-2]
    with pytest.raises(StageError, match=r"kinematics\.h5: shape_bend neither rises nor falls"):
        compared(other, folder)


def test_a_stronger_vortex_is_a_model_error(run, tmp_path):
    plane, root = measured_by(run, gain=1.25)
    folder = exported(plane, "microvec", tmp_path / "stronger", root)
    result, _, first = compared(run, folder, inputs=True)
    assert result["missing_runs"] == []
    assert result["verdict"] == "model error"
    assert "circulation" in result["wrong"]
    assert "Motion: not tested. Flow: no." in first
    assert "Vectors do not show the finger" in first
    assert "Circulation of the tip vortex" in first


def test_virtual_camera_is_put_before_the_vectors(run, tmp_path):
    """Vectors whose files count from the middle of the picture."""
    plane, root = measured_by(run)
    plane = plane.isel(time=slice(8, 16)).assign_coords(time=np.arange(8) / 100.0)
    path = exported(plane, "microvec", tmp_path / "seen", root) / "dpiv.toml"
    camera = (
        "{ columns = 640, rows = 520, density_ppp = 0.05, diameter_px = 2.5, background = 8.0,"
        " read_noise = 2.0, peak = 150.0, scale_mm_per_px = 0.25 }"
    )
    text = path.read_text().replace('camera = "none"', f"camera = {camera}")
    text = text.replace("at_s = 0.05", "at_s = 0.13").replace("window = 24", "window = 16")
    path.write_text(text)
    _, quantities, _ = compared(run, path.parent)
    assert quantities["circulation"]["verdict"] != "model error"
    assert relative_error(quantities) < 0.03  # 0.04 %; 10 % where only the simulation is smoothed


def test_a_virtual_laboratory_of_another_pressure_is_compared(run, monkeypatch):
    """A recording with errors of set-up and 5 % more pressure, whose clock begins 7 ms late."""
    folder = command.virtual_laboratory(run, 21.0, Machine(), quiet=True)
    result, quantities, first = compared(run, folder)
    assert abs(result["registration"]["delay_ms"] + 7.0) < 3.0
    assert result["registration"]["pressure_factor"] == pytest.approx(1.05, abs=0.01)
    verdicts = [quantities[name]["verdict"] for name in ("final_bend", "duration", "circulation")]
    assert verdicts == ["model error", "agrees", "agrees"]
    assert "Motion: no." in first
    figures = {path.name for path in (run.out / "lab" / folder.name / "figures").iterdir()}
    assert {"motion.pdf", "motion.svg", "picture.png", "series.svg"} <= figures
    monkeypatch.setattr(command, "run_registration", None)  # nothing is registered again
    monkeypatch.setattr(command, "run_comparison", lambda *known, **options: result)
    assert compared(run, folder)[2] == first
