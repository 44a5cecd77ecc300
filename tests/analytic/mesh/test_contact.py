"""Contact of a pinch: the gap of shapes, and laws that stop smoothly at the residual gap."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from pipeline.kinematics.contact import (
    ClosingLaw,
    closing_law,
    closing_summary,
    exponential,
    gap,
    ramp,
)
from pipeline.kinematics.pressure_law import stroke_law
from pipeline.kinematics.stage import kinematics_values
from pipeline.scene.pinch import Pinch
from piv.files.errors import StageError
from tests.conftest import motion_of, write_scene

PINCH = Pinch(half_distance=0.045)
LAWS = ["exponential", "ramp"]


def closed(pressure=20e3, pinch=PINCH, rate=2.2e-6, start=0.0):
    """A finger whose gap shrinks by `rate` m/Pa from 36 mm; its free law and the one that stops."""
    free = stroke_law(start, [(pressure, 0.005, 0.4)])
    return free, closing_law(
        free, lambda p: 0.036 - rate * (p - start), start, start + 80e3, pinch, "scene"
    )


def square(left, bottom, side):
    return np.array([left, bottom]) + side * np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)


def test_the_gap_of_a_square_to_plane_and_circle_is_exact():
    assert gap(square(-0.03, 0.1, 0.01), PINCH) == pytest.approx(0.02, abs=1e-15)
    assert gap(square(-0.005, 0.1, 0.01), PINCH) == pytest.approx(-0.005, abs=1e-15)
    for shape in ("cylinder", "sphere"):
        thing = {"shape": shape, "diameter": 0.01, "centre_height": 0.105}
        pinch = Pinch(half_distance=0.045, object=thing)
        # nearest to the middle of a side, then to a corner, then to the plane
        assert gap(square(-0.03, 0.1, 0.01), pinch) == pytest.approx(0.015, abs=1e-15)
        corner = gap(square(-0.03, 0.12, 0.01), pinch)
        assert corner == pytest.approx(np.hypot(0.02, 0.015) - 0.005, abs=1e-15)
        assert gap(square(-0.0105, 0.2, 0.01), pinch) == pytest.approx(0.0005, abs=1e-15)
    both = np.array([square(-0.03, 0.1, 0.01), square(-0.02, 0.1, 0.01)])
    assert gap(both, PINCH) == pytest.approx([0.02, 0.01], abs=1e-15)


@pytest.mark.parametrize("shape", [ramp, exponential])
def test_the_closing_maps_are_what_they_say(shape):
    x, h = np.linspace(-3, 3, 2401), 1e-5
    for derivative in (1, 2):
        numeric = (shape(x + h, derivative - 1) - shape(x - h, derivative - 1)) / (2 * h)
        # h²/6 of a derivative below 100
        assert numeric == pytest.approx(shape(x, derivative), abs=1e-8)
    # the gap is never smaller than the free one, nor than the residual
    assert (shape(x) >= np.maximum(x, 0)).all()
    assert (shape(x, 1) >= 0).all()
    assert shape(x, 1).max() <= 1 + 1e-12
    assert shape(x, 2).max() <= 1 + 1e-12
    assert ramp(np.array([-1.0, -2, 1, 1.5])).tolist() == [0, 0, 1, 1.5]


@settings(max_examples=50)
@given(
    residual=st.floats(1e-4, 3e-3), slowing=st.floats(1e-4, 8e-3), rate=st.floats(0.5e-6, 3e-6),
    pressure=st.floats(5e3, 40e3), start=st.floats(-20e3, 5e3), name=st.sampled_from(LAWS),
)  # fmt: skip
def test_the_gap_closes_monotonically_and_never_below_the_residual(
    residual, slowing, rate, pressure, start, name
):
    own = {"residual_gap": residual, "slowing_distance": slowing, "closing_law": name}
    pinch = Pinch(half_distance=0.045, **own)
    free, law = closed(pressure, pinch, rate, start)
    t = np.linspace(0, 0.6, 601)
    gaps = 0.036 - rate * (law(t) - start)
    if law is not free:
        assert isinstance(law, ClosingLaw)
        assert gaps.min() >= residual - 1e-12
    else:
        assert gaps.min() > residual
    if pressure >= start:
        assert (np.diff(gaps) <= 1e-15).all()
    # far from contact the law is the free one: exactly with the ramp, else to exp(-4 x)
    reach, within = (1, 1e-9) if name == "ramp" else (8, 1e-10 * slowing / rate)
    far = 0.036 - rate * (free(t) - start) > residual + reach * slowing + 1e-9
    assert law(t)[far] == pytest.approx(free(t)[far], abs=within)


def test_a_stroke_that_does_not_get_there_is_left_alone():
    free, law = closed(10e3)
    t = np.linspace(0, 0.6, 61)
    assert law(t) == pytest.approx(free(t), abs=1e-12)
    never = closing_law(free, lambda p: 0.036 - 1e-7 * p, 0.0, 40e3, PINCH, "scene")
    assert never is free
    assert "contact_time" not in closing_summary(t, np.full(61, 0.01), PINCH)


def test_the_fingers_let_go_as_they_came():
    free = stroke_law(0.0, [(20e3, 0.005, 0.4), (0.0, 0.6, 0.4)])
    law = closing_law(free, lambda p: 0.036 - 2.2e-6 * p, 0.0, 40e3, PINCH, "scene")
    t = np.linspace(0.59, 1.6, 400)
    assert law(t[:1]) == pytest.approx([law.hold], abs=1e-9)
    assert (np.diff(law(t)) <= 1e-9).all()
    assert law(t[-1:]) == pytest.approx(free(t[-1:]), abs=1e-9)


def test_contact_at_the_start_and_a_way_too_short_are_refused():
    free = stroke_law(0.0, [(20e3, 0.005, 0.4)])
    for wide, words in (
        (0.0004, r"gap of 0\.40 mm to the plane.*raise pinch\.half_distance"),
        (0.003, r"slowing_distance = 0\.003 m is more than the finger moves.*2\.50 mm"),
    ):
        with pytest.raises(StageError, match=words):
            closing_law(free, lambda p, wide=wide: wide - 1e-6 * p, 0.0, 40e3, PINCH, "scene")


def pinch_scene(folder, more="", kind="quarter"):
    return write_scene(folder, kind, more, parent="pinch")


def test_the_fingers_of_the_scene_meet_at_the_residual_gap(tmp_path):
    scene = pinch_scene(tmp_path / "s")
    data = kinematics_values(scene)
    motion = motion_of(scene)
    assert data["shape_gap"][-1] == pytest.approx(0.5e-3, abs=1e-9)
    assert data["gap"][-1] == pytest.approx(0.5e-3, abs=1e-9)
    assert data["mirror"] == 1
    assert data["least_gap"] >= 0.5e-3 - 1e-9
    # mirrored in x = 0 the two fingers are apart by twice the gap at every instant
    look = np.linspace(0, data["time"][-1], 101)
    left = np.array([motion.outline(p) for p in motion.law(look)])
    gaps = np.interp(look, data["time"], data["gap"])
    assert -left[..., 0].max(axis=1) == pytest.approx(gaps, abs=5e-8)
    # the start lies in the root's own corner: 0.3 µm of rounding
    assert (np.diff(data["gap"]) <= 1e-7).all()
    assert data["free_pressure"][-1] == pytest.approx(20e3, rel=1e-3)  # the chambers go on
    stopped = data["time"] > data["contact_time"]
    assert np.ptp(data["gap"][stopped]) < 1e-4
    assert data["pressure"][stopped].max() < 17e3
    # the splines through the shapes hold the gap to a micrometre between the knots as well
    knots = data["shape_parameter"]
    between = np.concatenate([knots[:-1] + part * np.diff(knots) for part in (0.25, 0.5, 0.75)])
    exact = np.array([motion.outline(p) for p in between])
    close = gap(exact, scene.pinch) < 0.006
    splined = gap(CubicSpline(knots, data["shape_outline"])(between), scene.pinch)
    assert np.abs(splined - gap(exact, scene.pinch))[close].max() < 1e-6
    assert np.abs(splined - gap(exact, scene.pinch)).max() < 2e-5


def test_an_opening_stroke_comes_first_where_the_scene_says_so(tmp_path):
    strokes = (
        "[motion]\nstrokes = [{ pressure_kpa = -15.0, start = 0.005, duration = 0.3 },"
        "{ pressure_kpa = 20.0, start = 0.3, duration = 0.4 }]\nend_time = 1.0"
    )
    data = kinematics_values(pinch_scene(tmp_path / "s", strokes))
    assert np.degrees(data["shape_bend"]).min() < -70
    assert np.degrees(data["shape_bend"]).max() > 70
    assert data["gap"][-1] == pytest.approx(0.5e-3, abs=1e-9)


@pytest.mark.parametrize("shape", ["cylinder", "sphere"])
def test_the_fingers_stop_at_an_object_between_the_tips(tmp_path, shape):
    thing = f'[pinch.object]\nshape = "{shape}"\ndiameter = 0.03\ncentre_height = 0.185\n'
    data = kinematics_values(pinch_scene(tmp_path / "s", thing))
    outline = data["shape_outline"][-1]
    side = np.roll(outline, -1, axis=0) - outline
    fine = np.concatenate([outline + k / 50 * side for k in range(50)])
    distance = np.hypot(fine[:, 0], fine[:, 1] - 0.185).min() - 0.015
    assert distance == pytest.approx(0.5e-3, abs=1e-7)
    assert data["shape_bend"][-1] < np.radians(60)  # sooner than at the plane, 75°
