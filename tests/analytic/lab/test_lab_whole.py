"""The comparison from dpiv.toml to the page: vectors, and a recording.

The commands are the user's; the flow of a run is an analytic vortex in place of the solver's.
"""

import h5py
import numpy as np
import pytest

from docs.evidence.lab_renderer import Filmed
from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.records import LAB_COMPARISON, RUN
from pipeline.kinematics import stage as kinematics_stage
from pipeline.runs.run import open_run
from piv.files.errors import StageError
from piv.formats.plane_series import write_plane
from piv.formats.recording import RecordingWriter
from postprocess.lab.inputs import EMPTY
from postprocess.lab.pose import Pose, camera_series
from softfinger import laboratory as command
from softfinger.make import Machine
from tests.lab_scene import CASE, PICTURES, state, state_vectors, vortex_series

INPUTS = """format = "inputs"
format_version = 2
[[input]]
name = "pressure"
key = "motion.strokes.0.pressure_kpa"
step = 1.0
limit = 0.2
reason = "sensor"
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
        patch.setattr(command, "level_windows", lambda *_: EMPTY)  # an exact flow
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
    times = TIMES[:40] if run.out.name == "pressure" else TIMES  # another end
    sheet = vortex_series(kinematics, times, spacing=SPACING).sel(x=slice(x0, x1), y=slice(y0, y1))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_plane(sheet.assign(p=0 * sheet["u"]), path)


def measured_by(run, gain: float = 1.0):
    """Vectors (50 Hz, 2 mm apart) of a vortex `gain` times as strong, and the finger's root (mm).

    In axes that begin somewhere in the picture.
    """
    kinematics_alone(run, "solve", None, True)
    kinematics = read_kinematics(run.path("kinematics"))
    pose = Pose(1e3, 0.0, kinematics.root, (0.065, 0.105))
    x, y = SPACING * np.arange(1, 76), SPACING * np.arange(1, 62)
    flow = vortex_series(kinematics, TIMES, gain=gain, spacing=SPACING)
    plane = camera_series(flow, pose, x, y, 0.05 + np.arange(15) / 50.0)
    plane = plane.drop_vars(["outline", "tip", "tip_direction", "dorsal_direction", "bend"])
    shift = np.array([-0.06, -0.11]) - [x[0], y[0]]
    at = {"x": plane["x"] + shift[0], "y": plane["y"] + shift[1], "time": np.arange(15) / 50.0}
    return plane.assign_coords(at), tuple(float(v) for v in 1e3 * (np.array(pose.at_px) + shift))


def compared(run, folder, inputs=False, quick=False):
    """comparison.json of a folder of data by the name of its quantities, and the page's answer."""
    options = {"inputs": inputs, "quick": quick, "quiet": True}
    page = command.compare_with(run, [folder], Machine(), **options)
    result = LAB_COMPARISON.read(page.parent / "comparison.json")
    text = page.read_text()
    first = text[text.index('id="answer"') : text.index("</header>")]
    return result, {q["name"]: q for q in result["quantities"]}, first


def test_vectors_are_compared_from_wherever_their_files_count(run, tmp_path):
    plane, root = measured_by(run)
    result, quantities, _ = compared(run, state_vectors(plane, tmp_path / "sound", root))
    assert result["verdict"] == "agrees", quantities
    assert result["not_varied"] == ["duration", "pressure"]
    assert abs(quantities["circulation"]["error"][0] / quantities["circulation"]["data"][0]) < 0.02
    assert np.hypot(*quantities["centre"]["error"]) < 0.3e-3
    assert "final_bend" not in quantities  # vectors do not show it
    with pytest.raises(StageError, match="--quick compares the motion, which vectors do not"):
        compared(run, tmp_path / "sound", quick=True)


def test_vectors_without_a_clock_are_compared_from_their_onset(run, tmp_path):
    """They begin 50 ms late; known to a few ms by what the analytic flow grows."""
    plane, root = measured_by(run)
    folder = state_vectors(plane, tmp_path / "onset", root, start='"from flow"')
    result, _, _ = compared(run, folder)
    found = result["registration"]
    assert found["delay_ms"] == pytest.approx(-50.0, abs=max(5.0, 3 * found["delay_std_ms"]))
    assert result["flow"] == "agrees"


def test_repeats_are_judged_by_their_mean(run, tmp_path):
    folders = []
    for number, gain in enumerate((0.98, 1.02)):
        plane, root = measured_by(run, gain=gain)
        folders.append(state_vectors(plane, tmp_path / f"run{number}", root))
    page = command.compare_with(run, folders, Machine(), inputs=False, quick=False, quiet=True)
    result = LAB_COMPARISON.read(page.parent / "comparison.json")
    assert page.parent.name == "run0+run1"
    assert len(result["repeats"]) == 2
    circulation = result["quantities"][0]
    assert abs(circulation["error"][0] / circulation["data"][0]) < 0.02
    assert "repeats" in [source["name"] for source in circulation["sources"]]
    assert "Each recording is registered alone" in page.read_text()


def test_a_bend_that_turns_back_is_refused_before_anything_is_solved(run, tmp_path):
    """As of a coupled motion, which overshoots: a bend angle belongs to several shapes."""
    other = open_run(run.scene.folder, "smoke", {}, tmp_path / "other")
    folder = state_vectors(measured_by(other)[0], tmp_path / "back")
    with h5py.File(other.path("kinematics"), "r+") as file:
        file["shape_bend"][-1] = 0.9 * file["shape_bend"][-2]
    with pytest.raises(StageError, match=r"kinematics\.h5: shape_bend neither rises nor falls"):
        compared(other, folder)


def test_a_stronger_vortex_is_a_model_error(run, tmp_path):
    plane, root = measured_by(run, gain=1.25)
    folder = state_vectors(plane, tmp_path / "stronger", root)
    result, quantities, first = compared(run, folder, inputs=True)
    assert result["not_varied"] == ["duration"]
    assert result["verdict"] == "model error"
    circulation = quantities["circulation"]
    assert circulation["verdict"] == "model error"
    # E is what the simulation lacks: a fifth of the recording's, to its own 95 % band
    expected = -0.2 * circulation["data"][0]
    assert abs(circulation["error"][0] - expected) < circulation["k"] * circulation["u_val"][0]
    assert "Motion: not tested. Flow: no." in first
    assert "Vectors do not show the finger" in first
    assert "Circulation of the tip vortex" in first


def test_a_recording_of_another_pressure_is_compared(run, tmp_path):
    """Pictures with errors of set-up and 5 % more pressure, whose clock begins 7 ms late."""
    kinematics_alone(run, "kinematics", None, True)
    kinematics = read_kinematics(run.path("kinematics"))
    pose = Pose(0.404, np.radians(1.0), kinematics.root, (152.5, 268.5))
    begin = 0.007 + np.arange(20) / 50.0
    times = np.column_stack([begin, begin + 0.002]).ravel()
    flow = vortex_series(kinematics, TIMES, spacing=SPACING)
    seen = kinematics, pose, 1.05 * kinematics.law(times), (320, 400)
    film, folder = Filmed(*seen, flow=flow, times=times), tmp_path / "recorded"
    folder.mkdir()
    with RecordingWriter(
        folder / "a.h5", (320, 400), np.uint8, 40, {"bits": 8}, times=times
    ) as out:
        for k in range(len(film)):
            out.write(k, film.frame(k))
        out.finish()
    state(folder, PICTURES)
    quick = command.compare_with(run, [folder], Machine(), inputs=True, quick=True, quiet=True)
    assert "Motion: no. Flow: not tested." in quick.read_text()
    result, quantities, first = compared(run, folder)
    assert abs(result["registration"]["delay_ms"] + 7.0) < 3.0
    assert result["registration"]["pressure_factor"] == pytest.approx(1.05, abs=0.01)
    verdicts = [quantities[name]["verdict"] for name in ("final_bend", "duration", "circulation")]
    assert verdicts == ["model error", "agrees", "agrees"]
    assert "Motion: no." in first
    lab = run.out / "lab" / folder.name
    figures = {path.name for path in (lab / "figures").iterdir()}
    assert {"flow.webp", "motion.svg", "picture.png", "series.svg"} <= figures
