"""Nonsense is found in the settings stage, before anything runs, in one sentence with the key and a value that works."""

import re
from pathlib import Path

import pytest

from fileio.errors import StageError
from pipeline.scene.predicted import predicted
from pipeline.scene.scene import Scene, load_scene
from tests.conftest import ROOT

STROKES = "[motion]\nstrokes = [{{ pressure_kpa = {p}, start = {t}, duration = {d} }}]"
NONSENSE = [
    # sections, words of the sentence
    ("[sheet]\nrate_hz = 1.0", ["sheet.rate_hz = 1", "0 pictures", "give at least 9.6"]),
    ("[camera]\ncentre = [5.0, 5.0]", ["camera.centre", "no water"]),
    ("[camera]\ncentre = [0.0, -0.2]", ["camera.centre", "no water"]),
    ("[piv]\nwindow = 400", ["piv.window = 400 px", "half the picture", "at most 256"]),
    ("[piv]\nwindow = 4096", ["piv.window", "512", "got 4096"]),
    ("[piv]\nframes = 4", ["piv", "frames = 4", "give 2, or 5"]),
    ("[camera]\nseed = -1", ["camera.seed", "got -1"]),
    ("[camera]\nseed = 123456789012345678901", ["camera.seed", "less than 4294967296"]),
    ("[camera]\ndensity_ppp = 1e6", ["camera.density_ppp", "0.5"]),
    ("[camera]\nbackground = 1e6", ["camera.background", "as bright as", "at most 230"]),
    ("[camera]\nread_noise = 1e9", ["camera.read_noise", "256 levels", "at most 25.6"]),
    ("[camera]\nparticle_diameter_px = 300.0", ["camera.particle_diameter_px", "20"]),
    ("[camera]\nbits = 11", ["camera.bits", "8, 10, 12 or 16"]),
    ("[camera]\ncolumns = 100000", ["camera.columns", "16384"]),
    ("[camera]\nframe_rate_hz = 1e9", ["camera.frame_rate_hz", "TB of disk", "frames"]),
    ("[piv]\nspacing = 4096", ["piv.spacing", "512"]),
    ("[piv]\nspacing = 100", ["piv.spacing = 100 px", "eight vectors", "at most 64"]),
    ("[vortices]\nstencil_radius = 1.0", ["vortices.stencil_radius", "quarter of the picture"]),
    ("[numerics]\nwrite_interval = 1e-9", ["numerics.write_interval", "time_step", "at least 0.002"]),
    ("[numerics]\nouter_correctors = 1000000000", ["numerics.outer_correctors", "50"]),
    ("[numerics]\npressure_correctors = 1000", ["numerics.pressure_correctors", "10"]),
    ("[numerics]\nmax_courant = 1e9", ["numerics.max_courant", "100"]),
    ("[numerics]\ntime_step = 1e-12", ["numerics.time_step", "steps", "give at least"]),
    ("[mesh]\ntip_cell = 1e-6", ["mesh.tip_cell", "thousandth of the finger's thickness", "at least 1.45e-05"]),
    ("[mesh]\ntip_cell = 1.5e-5\nwall_cell = 1.5e-5\nnear_cell = 1.5e-5\nwall_first_layer = 1.5e-5", ["cells in", "GB of memory", "times larger"]),
    ("[mesh]\nnear_distance = 50.0", ["mesh.near_distance", "more than the tank"]),
    ("[mesh]\nedge_layer = 1.0", ["mesh.edge_layer", "finger's width"]),
    ("[finger]\ntilt_deg = 90", ["finger.tilt_deg", "60", "got 90"]),
    ("[tank]\nsize = [19.0, 0.33, 0.3]", ["tank.size", "millimetres", "at most 1 and 5"]),
    ("[finger]\nthickness = 1.0", ["finger.thickness", "length", "at most 0.035"]),
    ("[sheet]\nthickness = 1.0", ["sheet.thickness", "0.05"]),
    ("[sheet]\nmargin = 1e3", ["sheet.spacing", "sheet.margin"]),
    ("[sheet]\nspacing = 0.3", ["sheet.spacing", "eight points"]),
    ("[finger]\nwidth = 1e-6", ["finger.width", "thickness", "at least 0.000725"]),
    ("[finger]\nroot_corner_radius = 0.1", ["finger.root_corner_radius", "half the thickness", "at most 0.0071"]),
    ("[finger.tip]\ncorner_radius = 0.1", ["finger.tip.corner_radius", "half the thickness"]),
    ("[finger]\nlength = '9_98'", ["finger.length", "valid number", "got '9_98'"]),
    ("[tank]\nwater_depth = 0.2", ["tank.water_depth = 0.2 m does not cover finger.root", "0.245 m above"]),
    ("[finger]\nroot = [0.4, 0.2]", ["finger.root = [0.4, 0.2] is not in the tank"]),
    ("[finger]\nroot = ['0', '0.2']", ["finger.root", "valid number"]),
    ("[camera]\nseed = '12'", ["camera.seed", "valid integer"]),
    ("[numerics]\ntime_step = true", ["numerics.time_step", "valid number"]),
    ("[motion]\nmax_bend_step_deg = 1e-9", ["motion.max_bend_step_deg", "0.1"]),
    (STROKES.format(p=1e5, t=0, d=0.4), ["pressure_kpa", "500"]),
    (STROKES.format(p=-200, t=0, d=0.4), ["pressure_kpa", "-100"]),
    (STROKES.format(p=20, t=0, d=1e-9), ["strokes[0].duration", "time_step", "at least 0.008"]),
    # a finger that does not move, and a run that is over at once
    (STROKES.format(p=0.0, t=0.005, d=0.4), ["no stroke changes the pressure", "another pressure_kpa"]),
    (STROKES.format(p=20.0, t=5.0, d=0.4), ["no stroke changes the pressure", "earlier start"]),
    ("[motion]\nend_time = 0.001", ["motion.end_time", "give at least 0.008"]),
    ("[motion]\nend_time = 0.002", ["motion.end_time", "give at least 0.008"]),
    ("[numerics]\ntime_step = 1e-3\n[motion]\nend_time = 0.004", ["sheet.rate_hz = 500", "2 pictures", "give at least 1000"]),
    ("[motion]\nend_time = 1e9", ["numerics.time_step", "steps"]),
    ('mesh = "fine"', ["mesh", "got 'fine'"]),
    ("body = 3", ["body", "got 3"]),
]  # fmt: skip


def smoke(folder: Path, more: str) -> Scene:
    """The shipped finger at level smoke with values of its own, which hold at every level."""
    folder.mkdir()
    (folder / "scene.toml").write_text(f'extends = "{ROOT / "cases" / "single_finger"}"\n{more}\n')
    return load_scene(folder, "smoke")


@pytest.mark.parametrize(
    "more, words", NONSENSE, ids=[more.replace("\n", " ")[:60] for more, _ in NONSENSE]
)
def test_nonsense_is_refused_before_anything_runs(tmp_path, more, words):
    with pytest.raises(StageError) as caught:
        smoke(tmp_path / "bad", more)
    message = str(caught.value)
    assert "scene.toml" in message
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize("rate", [1.0, 2.0, 5.0])
def test_the_rate_that_is_asked_for_is_accepted(tmp_path, rate):
    """The remedies once led in a circle: from too few pictures to a rate that does not divide the time step, and back."""
    with pytest.raises(StageError) as caught:
        smoke(tmp_path / "bad", f"[sheet]\nrate_hz = {rate}")
    asked = re.search(r"give at least ([\d.]+)$", str(caught.value))
    assert asked
    assert smoke(tmp_path / "good", f"[sheet]\nrate_hz = {asked.group(1)}").remarks() == []


def test_a_later_stroke_that_never_begins_is_warned_of(tmp_path):
    strokes = (
        "[motion]\nstrokes = [{ pressure_kpa = 20.0, start = 0.0, duration = 0.4 },"
        " { pressure_kpa = 0.0, start = 9.0, duration = 0.4 }]"
    )
    assert "strokes[1] starts at 9 s" in smoke(tmp_path / "s", strokes).remarks()[0]


def test_the_predicted_size_is_that_of_the_run_within_a_factor_of_three(tmp_path):
    size = predicted(smoke(tmp_path / "s", ""))
    assert 1000 < size.cells < 9000  # 3054 are meshed
    assert size.steps == pytest.approx(210)
