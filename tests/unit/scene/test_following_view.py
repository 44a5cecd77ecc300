"""The camera follows from the finger's path, and a tip that it does not see is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.kinematics.camera_window import TipPath, _boxes, _travel, following, tip_path
from pipeline.runs.run import open_run
from pipeline.scene.limits import field_count
from pipeline.scene.measurement import Vortices
from pipeline.scene.predicted import picture_of
from pipeline.scene.scene import load_scene
from pipeline.structure.finger import path_in_water
from piv.files.errors import StageError
from piv.sequence.frame_sets import SequenceOptions, frame_sets
from softfinger.make import Machine, make
from tests.conftest import CASES, motion_of, write_scene

SINGLE = CASES / "single_finger"


def write(folder, text):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.toml").write_text(f'extends = "{SINGLE}"\n{text}')
    return folder


TANK = st.tuples(st.floats(0.15, 1.0), st.floats(0.15, 0.8))
STROKES = st.lists(st.floats(-20, -1) | st.floats(1, 40), min_size=1, max_size=3)
STATED = st.sampled_from(["", "", "scale_mm_per_px = 0.1", "centre = [0.02, 0.19]"])


@settings(max_examples=40, derandomize=True)
@given(TANK, st.floats(-0.1, 0.1), st.floats(0.3, 0.95), st.floats(0.03, 0.2), STROKES, STATED)
def test_the_tip_is_in_view_at_every_instant_or_the_scene_is_refused(
    tmp_path_factory, tank, x, y, length, kpa, stated
):
    """The paper's equations bend a finger of any length."""
    stroke = "{{ pressure_kpa = {:.6g}, start = {}, duration = 0.2 }}"
    strokes = ", ".join(stroke.format(p, 0.2 * k + 0.01) for k, p in enumerate(kpa))
    folder = write(
        tmp_path_factory.mktemp("scene"),
        f"[tank]\nsize = [{tank[0]:.4f}, {tank[1]:.4f}, 0.2]\nwater_depth = {0.95 * tank[1]:.4f}\n"
        f"[finger]\nroot = [{x:.4f}, {y * tank[1]:.4f}]\nlength = {length:.4f}\n"
        f'[motion]\nsource = "paper_equations"\nstrokes = [{strokes}]\n'
        f"end_time = {0.2 * len(kpa) + 0.02:.2f}\n[camera]\n{stated}\n",
    )
    run, refusal = None, ""
    try:
        run = open_run(folder, "coarse")
        run.check("report")
    except StageError as error:
        run, refusal = None, str(error)
    if run is None:
        assert str(folder) in refusal
        assert "\n" not in refusal
        return
    camera, motion = run.scene.camera, motion_of(run.scene)
    half = 0.5 * camera.pixel * np.array([camera.columns, camera.rows])
    for pressure in motion.law(np.linspace(0, run.scene.motion.end_time, 200)):
        tip = motion.to_tank(motion.shapes.tip(pressure)[0])
        assert (np.abs(tip - camera.centre) < half).all()


def test_a_child_with_another_finger_does_not_see_its_parents_view(tmp_path):
    """Unless it states its own; a smaller finger has a closer view and weaker vortices."""
    short = 'source = "paper_equations"\nend_time = 0.42\n[finger]\nlength = 0.035\n'
    run = open_run(write(tmp_path / "a", f"[motion]\n{short}"), "smoke")
    assert run.scene.camera.centre == pytest.approx((0.012, 0.228), abs=0.01)
    shipped = open_run(SINGLE, "smoke").scene
    assert run.scene.camera.scale_mm_per_px < 0.125 * 2 * 0.75  # half the pixels see it all
    assert run.scene.vortices.min_circulation < shipped.vortices.min_circulation
    own = write(tmp_path / "b", f"[camera]\ncentre = [0, 0.2]\n[motion]\n{short}")
    assert open_run(own, "smoke").scene.camera.scale_mm_per_px == shipped.camera.scale_mm_per_px
    other = write(tmp_path / "c", "[piv]\nwindow = 24\n")
    assert open_run(other, "smoke").scene.camera == shipped.camera


def test_a_small_picture_of_stated_scale_leaves_out_the_root(tmp_path):
    camera = "[camera]\ncolumns = 320\nrows = 256\nscale_mm_per_px = 0.25\n"
    run = open_run(write(tmp_path, f"[tank]\nwater_depth = 0.31\n{camera}"), "smoke")
    run.check("report")
    assert run.scene.camera.centre[1] + 0.032 < run.scene.finger.root[1]


@pytest.mark.parametrize("level", ["smoke", "coarse"])
@pytest.mark.parametrize("shipped, reach", [("single_finger", 45e-3), ("pinch", 85e-3)])
def test_the_view_holds_where_vortices_go_and_is_sharp_enough(tmp_path, shipped, reach, level):
    """Below the tips at least the water of the views that were set by hand for these scenes."""
    text = f'extends = "{CASES / shipped}"\n[tank]\nwater_depth = 0.301\n'
    (tmp_path / "scene.toml").write_text(text)
    scene = open_run(tmp_path, level).scene
    by_hand = open_run(CASES / shipped).scene.camera
    camera, tip = scene.camera, tip_path(scene).places
    low, high = picture_of(camera)
    assert low[1] < picture_of(by_hand)[0][1] + 10e-3
    assert tip[:, 1].min() - low[1] > reach
    assert low[0] < tip[:, 0].min() - 0.03
    assert high[1] > scene.finger.root[1]
    assert camera.columns * camera.rows <= 1.1 * 1600 * 1280
    assert scene.finger.thickness / (scene.piv.window * camera.pixel) > 2.5


def test_a_coupled_finger_is_seen_as_fast_as_water_lets_it_be():
    """Prescribed, f90's tip has 2.3 m/s, in water 0.6: weaker vortices count."""
    strokes = [{"pressure_kpa": 20.0, "start": 0.005, "duration": 0.05}]
    moved = {"motion.strokes": strokes, "camera.centre": None}
    still, wet = (
        load_scene(SINGLE, "smoke", moved | {"motion.source": source})
        for source in ("fea", "structure")
    )
    prescribed, coupled = path_in_water(still), path_in_water(wet)
    assert np.array_equal(prescribed.places, tip_path(still).places)
    assert coupled.speed < 0.5 * prescribed.speed
    assert coupled.travel.max() < 0.5 * prescribed.travel.max()
    # poses at rest and those that the finger swings to are both seen
    assert coupled.places[:, 1].max() >= prescribed.places[:, 1].max()
    wet = wet.model_copy(update={"vortices": Vortices()})
    least = (following(wet, path)["vortices.min_circulation"] for path in (coupled, prescribed))
    assert next(least) < 0.5 * next(least)


def test_a_vortex_that_is_shed_earlier_goes_farther(tmp_path):
    """Half the square of 0.3 m/s in 0.1 s makes 45 cm²/s, which move at 49 mm/s, 14.5 mm apart."""
    time = np.linspace(0, 0.2, 2001)
    travel = _travel(time, np.where(time < 0.1, 0.3, 0.0), 0.0145)
    assert travel[-1] == 0.0
    assert travel[time.searchsorted(0.1)] == pytest.approx(4.9e-3, rel=0.02)
    assert travel[0] == pytest.approx(1.5 * 4.9e-3, rel=0.02)


def test_the_view_is_long_ahead_of_a_tip_that_does_not_turn_back(tmp_path):
    scene = load_scene(write(tmp_path, "[finger]\nlength = 0.03\n"), "smoke")
    way, far = np.array([[0.0, 0.2], [0.03, 0.2]]), np.full(2, 0.2)  # m
    one, back = (_boxes(scene, TipPath(way, 0.5, turns, far, np.zeros(2)))[0] for turns in (0, 1))
    # 0.8 lengths more to the right alone; 0.8 thicknesses less around, where no vortices merge
    less = 0.8 * scene.finger.thickness
    assert one - back == pytest.approx(
        np.array([[1, 1], [-1, -1]]) * less + [[0, 0], [0.024, 0]], abs=1e-3
    )


def test_the_view_of_a_pinch_is_as_long_above_the_tips_as_below(tmp_path):
    """The upper pair of an own pinch left the view when it went up between the fingers."""
    (tmp_path / "scene.toml").write_text(f'extends = "{CASES / "pinch"}"')
    scene = load_scene(tmp_path, "smoke")
    way, far = np.array([[-0.02, 0.12], [0.0, 0.12]]), np.full(2, 0.02)  # m
    low, high = _boxes(scene, TipPath(way, 0.5, 0, far, np.zeros(2)))[0][:, 1]
    assert high - 0.12 == pytest.approx(0.12 - low)
    assert high - 0.12 > 2 * 0.02


def test_a_tip_that_leaves_a_stated_view_is_refused_before_anything_is_made(tmp_path):
    run = open_run(write(tmp_path, "[finger]\nroot = [0, 0.2]\n[camera]\ncentre = [0.1, 0.19]\n"))
    with pytest.raises(StageError, match=r"camera\.centre = \[0\.1, 0\.19\] m: the tip leaves"):
        run.check("report")
    run.check("solve")  # the flow needs no camera
    assert not run.out.exists()


def test_before_the_bending_analysis_the_view_is_open(tmp_path):
    """And the check says that the states are missing."""
    run = open_run(write(tmp_path, '[motion]\nstates = "s.h5"'), "smoke")
    assert run.scene.camera.centre is None
    with pytest.raises(StageError, match=r"s\.h5"):
        run.check("report")


def test_a_computed_motion_that_leaves_the_view_is_refused_before_the_mesh(tmp_path, monkeypatch):
    """Of an own actuator or a coupled finger, whose path is not known before."""
    scene = write_scene(tmp_path, more="[camera]\ncentre = [0.2, 0.1]\n")
    seen = TipPath(np.array([[0.2, 0.1]]), 0.1, 0, *np.zeros((2, 1)))
    monkeypatch.setattr("pipeline.runs.run.tip_path", lambda _: seen)
    run = open_run(scene.folder, "tiny")
    with pytest.raises(StageError, match="the tip leaves the picture"):
        make(run, "sheet", Machine(), quiet=True)
    assert run.path("kinematics").exists()
    assert not run.path("mesh").exists()


@pytest.mark.parametrize("paired, in_set, every", [(1, 2, 3), (1, 5, 2), (4, 2, 1), (7, 2, 2)])
def test_fields_are_counted_as_piv_takes_them(paired, in_set, every):
    for count in range(12, 30):
        taken = sum(number % paired < 2 for number in range(count)) if paired > 1 else count
        pairing = "1-2,3-4" if paired > 1 else "1-2,2-3"
        options = SequenceOptions(pairing=pairing, frames=in_set, every=every)
        sets = frame_sets(taken - (paired > 1 and taken % 2), options)
        assert field_count(count, paired, in_set, every) == len(sets)
