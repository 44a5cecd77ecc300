"""A scene that cannot be is refused before anything runs, with the key and a value that works."""

import re
import time
from pathlib import Path

import numpy as np
import pytest

from pipeline.kinematics.stage import kinematics_values
from pipeline.scene.scene import Scene, load_scene
from pipeline.sheet import view_axes
from piv.files.errors import StageError
from tests.conftest import CASES

SINGLE = CASES / "single_finger"
OBJECT = "[pinch.object]\ndiameter = {d}\ncentre_height = {y}\n"
SUPPORT = "[support]\nsize = [{x}, {h}, 0.05]\nbottom = {y}\n"
CELLS = ("tip_cell", "wall_cell", "near_cell", "wall_first_layer")
SMALL = "\n".join(["[mesh]", *(f"{key} = 1.5e-5" for key in CELLS)])
MANY_FRAMES = "[piv]\nframes = 99\n[camera]\npairs_every = 1\n[sheet]\nrate_hz = 100.0"
TWO = "[[motion.strokes]]\npressure_kpa = {}\nstart = {}\nduration = 0.1\n"
STROKES = "[motion]\nstrokes = [{{ pressure_kpa = {p}, start = {t}, duration = {d} }}]"
MEASURED = '[motion]\nstrokes = []\npressure_csv = "p.csv"\n'
NONSENSE = [
    # sections, words of the sentence
    ("[sheet]\nrate_hz = 1.0", ["sheet.rate_hz = 1", "0 pictures", "give at least 9.6"]),
    ("[camera]\ncentre = [0.0, -0.2]", ["camera.centre", "no water"]),
    ("[piv]\nwindow = 400", ["piv.window = 400 px", "half the picture", "at most 256"]),
    ("[piv]\nwindow = 4096", ["piv.window", "512", "got 4096"]),
    ("[piv]\nframes = 4", ["piv", "frames = 4", "give 2, or 5"]),
    ("[camera]\nseed = 123456789012345678901", ["camera.seed", "less than 4294967296"]),
    ("[camera]\nbackground = 1e6", ["camera.background", "as bright as", "at most 230"]),
    ("[camera]\nread_noise = 1e9", ["camera.read_noise", "256 levels", "at most 25.6"]),
    ("[camera]\nbits = 11", ["camera.bits", "8, 10, 12 or 16"]),
    ("[camera]\nframe_rate_hz = 1e9", ["camera.frame_rate_hz", "TB of disk", "frames"]),
    ("[piv]\nspacing = 100", ["piv.spacing = 100 px", "eight vectors", "at most 64"]),
    ("[vortices]\nscale = 1.0", ["vortices.scale", "quarter of the picture"]),
    ("[numerics]\nwrite_interval = 1e-9", ["numerics.write_interval", "at least 0.002"]),
    ("[numerics]\ntime_step = 1e-12", ["numerics.time_step", "steps", "give at least"]),
    ("[fluid]\nkinematic_viscosity = 1.004", ["fluid.kinematic_viscosity", "mm²/s", "0.01"]),
    ("[fluid]\nkinematic_viscosity = 1e-12", ["fluid.kinematic_viscosity", "1e-07"]),
    ("[fluid]\ndensity = 0.998", ["fluid.density", "g/cm³", "100"]),
    ("[mesh]\ntip_cell = 1e-6", ["mesh.tip_cell", "thousandth of the finger", "at least 1.45e-05"]),
    ("[mesh]\nwall_cell = 0.02", ["mesh.wall_cell", "third", "at most 0.00483"]),
    ("[mesh]\nfar_cell = 0.2", ["mesh.far_cell", "0.075"]),
    ("[mesh]\nwall_first_layer = 0.004", ["mesh.wall_first_layer", "0.0024"]),
    ("[mesh]\nwall_grading = 0.001", ["mesh.wall_grading", "0.02"]),
    ("[mesh]\ntip_transition = 5e-324", ["mesh.tip_transition", "thousandth"]),
    (SMALL, ["cells in", "GB of memory", "times larger"]),
    ("[mesh]\nnear_distance = 50.0", ["mesh.near_distance", "more than the tank"]),
    ("[mesh]\nnear_offset = [0.0, 50.0]", ["mesh.near_offset", "more than the tank"]),
    ("[mesh]\nedge_layer = 1.0", ["mesh.edge_layer", "finger's width"]),
    ("[tank]\nsize = [19.0, 0.33, 0.3]", ["tank.size", "millimetres", "at most 1 and 5"]),
    ("[finger]\nlength = 70.0", ["millimetres"]),
    ("[finger]\nlenght = 0.07", ["finger.lenght", "not known"]),
    ("[finger]\ntilt_deg = nan", ["finger.tilt_deg", "finite"]),
    ("[finger.tip]\nthickness = 0.005", ["finger.tip", "length"]),
    ("[motion]\npath_step = 0.1", ["motion.path_step", "rigid"]),
    ("[motion]\nend_time = 0.4205", ["motion.end_time", "give"]),
    (MEASURED + "start_pressure_kpa = 5.0", ["start_pressure_kpa", "remove"]),
    (TWO.format(2, 0.2) + TWO.format(1, 0.1), ["strokes", "sort"]),
    ("[tank]\nwater_depth = 0.4", ["water_depth", "exceeds"]),
    ("[sheet]\nz = 0.2", ["sheet.z", "outside"]),
    ("[sheet]\nz = 0.01", ["sheet.z", "symmetry plane"]),
    ("[sheet]\nrate_hz = 700", ["time_step", "divide"]),
    ("[sheet]\nspacing = 1e-310", ["too small"]),
    ("[sheet]\nspacing = 1e-6", ["sheet.spacing", "points"]),
    ("[camera]\ncolumns = 1" + 400 * "0", ["camera.columns", "16384"]),
    ('[fluid]\nturbulence = "kepsilon"', ["fluid.turbulence", "kepsilon"]),
    ("level = 3", ["level", "not known"]),
    ("[finger]\nthickness = 1.0", ["finger.thickness", "length", "at most 0.035"]),
    ("[sheet]\nmargin = 1e3", ["sheet.spacing", "sheet.margin"]),
    ("[sheet]\nspacing = 0.3", ["sheet.spacing", "eight points", "at most"]),
    ("[finger]\nwidth = 1e-6", ["finger.width", "thickness", "at least 0.000725"]),
    ("[finger]\nroot_corner_radius = 0.1", ["root_corner_radius", "half the thickness", "0.0071"]),
    ("[finger.tip]\ncorner_radius = 0.1", ["finger.tip.corner_radius", "half the thickness"]),
    ("[finger]\nlength = '9_98'", ["finger.length", "valid number", "got '9_98'"]),
    ("[tank]\nwater_depth = 0.2", ["0.2 m does not cover finger.root", "0.245 m above"]),
    ("[finger]\nroot = [0.4, 0.2]", ["finger.root = [0.4, 0.2] is not in the tank"]),
    ("[camera]\nseed = '12'", ["camera.seed", "valid integer"]),
    ("[numerics]\ntime_step = true", ["numerics.time_step", "valid number"]),
    (STROKES.format(p=1e5, t=0, d=0.4), ["pressure_kpa", "500"]),
    (STROKES.format(p=20, t=0, d=1e-9), ["strokes[0].duration", "time_step", "at least 0.008"]),
    # a finger that does not move, and a run that is over at once
    (STROKES.format(p=0.0, t=0.005, d=0.4), ["no stroke changes the pressure", "another pressure"]),
    (STROKES.format(p=20.0, t=5.0, d=0.4), ["no stroke changes the pressure", "earlier start"]),
    ("[motion]\nend_time = 0.001", ["motion.end_time", "give at least 0.008"]),
    ("[numerics]\ntime_step = 1e-3\n[motion]\nend_time = 0.004", ["2 pictures", "at least 1000"]),
    ("[motion]\nend_time = 1e9", ["motion.end_time", "at most 600"]),
    ('mesh = "fine"', ["mesh: give a table (got 'fine')"]),
    ("[motion]\nstrokes = { a = 1 }", ["motion.strokes: give a list"]),
    ("[numerics]\nmax_courant = 1e-300", ["numerics.max_courant: ", "greater than or equal"]),
    ("body = 3", ["body", "got 3"]),
    # accepted and meaningless before
    ("[structure]\nbending_stiffness = 1e-12", ["structure.bending_stiffness", "7.11e-06"]),
    (MANY_FRAMES, ["piv.frames = 99", "42 frames", "0 vector fields", "fewer than 2"]),
    ("[piv]\nevery = 10000", ["piv.every = 10000", "1 vector fields"]),
    ("[camera]\npairs_every = 10000", ["camera.pairs_every = 10000", "1 vector fields"]),
    ("[sheet]\nevery = 10000", ["takes 1 frames", "0 vector fields", "sheet.every = 10000"]),
    ("[sheet]\nrate_hz = 10.0", ["sheet.rate_hz = 10", "1 vector fields"]),
    ("[camera]\nframe_rate_hz = 7.3", ["camera.frame_rate_hz = 7.3 Hz", "at least 50"]),
    ("[camera]\ndensity_ppp = 1e-9", ["camera.density_ppp", "particles in a window", "0.00195"]),
    ("[camera]\nelectrons_per_level = 1e-9", ["camera.electrons_per_level", "at least 0.39"]),
    ("[sheet]\nthickness = 1e-12", ["sheet.thickness", "0.0001"]),
    ("[mesh]\nlayer_growth = 1.0000001", ["mesh.layer_growth", "1.02"]),
]  # fmt: skip


PINCH = [
    ("[finger]\nroot = [0.01, 0.245]", ["finger.root[0]", "half_distance only"]),
    ('[finger]\nventral = "-x"', ["finger.ventral", "towards each other"]),
    ("[pinch]\nhalf_distance = 0.3", ["pinch.half_distance", "walls", "0.29275"]),
    ("[pinch]\nhalf_distance = 0.0105", ["pinch.half_distance", "0.0035", "raise half_distance"]),
    ("[pinch]\nresidual_gap = 0.0", ["pinch.residual_gap", "got 0"]),
    ('[pinch]\nclosing_law = "sudden"', ["pinch.closing_law", "ramp", "sudden"]),
    ("[pinch]\ngap = 0.001", ["pinch.gap", "not known"]),
    ("[sheet]\nz = 0.01", ["sheet.z", "symmetry plane"]),
    (OBJECT.format(d=0.03, y=0.29), ["pinch.object.centre_height", "out of the water"]),
    (OBJECT.format(d=0.08, y=0.19), ["pinch.object.diameter", "opening", "0.0745"]),
    ("[pinch.object]\ndiameter = 0.02", ["pinch.object.centre_height", "missing"]),
    (SUPPORT.format(x=0.1, h=0.01, y=0.24), ["support.bottom", "roots"]),
    (SUPPORT.format(x=0.1, h=0.06, y=0.25), ["support.size[1]", "surface"]),
    (SUPPORT.format(x=0.7, h=0.01, y=0.25), ["support.size", "tank"]),
]


def smoke(folder: Path, more: str, parent: str = "single_finger") -> Scene:
    """A shipped scene at level smoke with values of its own, which hold at every level."""
    folder.mkdir()
    (folder / "scene.toml").write_text(f'extends = "{CASES / parent}"\n{more}\n')
    return load_scene(folder, "smoke")


@pytest.mark.parametrize(
    "parent, more, words",
    [("single_finger", *row) for row in NONSENSE] + [("pinch", *row) for row in PINCH],
)
def test_nonsense_is_refused_before_anything_runs(tmp_path, parent, more, words):
    with pytest.raises(StageError) as caught:
        smoke(tmp_path / "bad", more, parent)
    message = str(caught.value)
    assert "\n" not in message
    for word in ("scene.toml", *words):
        assert word in message


@pytest.mark.parametrize("rate", [1.0, 2.0, 5.0])
def test_the_rate_that_is_asked_for_is_accepted(tmp_path, rate):
    every = "[camera]\npairs_every = 1"
    with pytest.raises(StageError) as caught:
        smoke(tmp_path / "bad", f"{every}\n[sheet]\nrate_hz = {rate}")
    asked = re.search(r"give at least ([\d.]+)$", str(caught.value))
    assert asked
    good = smoke(tmp_path / "good", f"{every}\n[sheet]\nrate_hz = {asked.group(1)}")
    assert not any("warning" in remark for remark in good.remarks())


NO_MOTION = [
    (STROKES.format(p=20, t=0, d=1e6), ["[motion] moves the body", "stand still"]),
    (STROKES.format(p=0.002, t=0, d=0.4), ["[motion] moves the body", "stand still"]),
    ("[motion]\nmax_bend_step_deg = 0.1", ["max_bend_step_deg", "shapes", "give at least 0.43"]),
]
TURN = """title = "a turn"
body = {{ shape = "plate", chord = 0.02, thickness = 1e-3, centre = [0.0, 0.15], depth = 0.1 }}
model = {{ kind = "2d" }}
camera = {{ columns = 200, rows = 200, centre = [0.0, 0.15] }}
numerics = {{ time_step = 2e-3 }}
mesh = {{ wall_cell = 1e-3, wall_first_layer = 4e-4, wall_layers = 2, tip_cell = 1e-3,
  near_cell = 3e-3, far_cell = 0.02 }}
motion = {{ source = "rigid", end_time = 0.4, rotation = {{ kind = "sine", amplitude = {turn},
  period = {p}, smoothing = {smooth} }} }}
[levels.smoke]
"""
TURNS = [
    ((0.01, 1e5, 0.2), ["motion.path_step", "shapes"]),
    ((0.01, 1e-3, 0.2), ["[motion] moves the body", "stand still"]),
    ((0.01, 5.0, 2e-3), ["motion.rotation.period = 0.002 s", "at least 0.016"]),
    ((1e-3, 5.0, 0.2), ["motion.rotation.smoothing = 0.001 s", "at least 0.002"]),
]


@pytest.mark.parametrize(
    "text, words",
    [(f'extends = "PARENT"\n{more}', w) for more, w in NO_MOTION]
    + [(TURN.format(smooth=s, turn=a, p=p), w) for (s, a, p), w in TURNS],
)
def test_a_motion_of_nothing_or_of_too_many_shapes_is_refused_within_seconds(tmp_path, text, words):
    text = text.replace(",\n ", ", ").replace("PARENT", str(SINGLE))
    (tmp_path / "scene.toml").write_text(text)
    begun = time.process_time()
    with pytest.raises(StageError) as caught:
        kinematics_values(load_scene(tmp_path, "smoke"))
    assert time.process_time() - begun < 10  # s: the meshes of as many shapes take minutes
    for word in ("scene.toml", *words):
        assert word in str(caught.value)


def test_a_later_stroke_that_never_begins_is_warned_of(tmp_path):
    strokes = (
        "[motion]\nstrokes = [{ pressure_kpa = 20.0, start = 0.0, duration = 0.4 },"
        " { pressure_kpa = 0.0, start = 9.0, duration = 0.4 }]"
    )
    assert "strokes[1] starts at 9 s" in smoke(tmp_path / "s", strokes).remarks()[0]


def test_recording_and_strokes_exclude_each_other(tmp_path):
    motion = '[motion]\nsource = "recording"\nrecording = "m.h5"\n'
    (tmp_path / "scene.toml").write_text(f'extends = "{SINGLE}"\n{motion}')
    with pytest.raises(StageError, match=r"no strokes \(strokes = \[\]\)"):
        load_scene(tmp_path, "smoke")


def test_view_of_a_laboratory_camera_stays_in_the_water():
    scene = load_scene(SINGLE, "smoke")
    x, y = view_axes((-0.08, 0.12, 0.10, 0.40), scene)
    spacing = scene.sheet.spacing
    assert x[0] == pytest.approx(-0.08, abs=spacing)
    assert y[-1] == pytest.approx(scene.tank.water_depth, abs=spacing)
    assert np.allclose(np.diff(x), spacing)
    with pytest.raises(StageError, match="shows no water"):
        view_axes((0.5, 0.6, 0.1, 0.2), scene)
