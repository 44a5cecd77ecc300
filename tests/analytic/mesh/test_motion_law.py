"""Pressure laws and shapes against exact values and exact derivatives."""

import numpy as np
import pytest

from pipeline.kinematics.pressure_law import (
    SETTLING_2_PERCENT,
    measured_law,
    stroke_law,
    three_pole,
)
from pipeline.kinematics.shapes import FingerShapes, add_tip, circular_states, rounded_strip
from piv.files.errors import StageError

LENGTH, THICKNESS = 0.07, 0.0145


def kinematics(bend=(-1.0, 0.0, 1.0, 2.0), tip=0.0):
    pressure = np.array([-10e3, 0, 10e3, 20e3])
    states = add_tip(circular_states(pressure, np.array(bend), LENGTH, THICKNESS), tip, 0.01)
    s = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(states.profile[1], axis=0).T))])
    return FingerShapes(states, rounded_strip(s[-1], states.thickness[1], s, 0.002, 0.002))


def test_a_stroke_is_settled_to_two_percent_after_its_duration():
    # the constant's own digits
    assert three_pole(np.array(SETTLING_2_PERCENT)) == pytest.approx(0.98, abs=1e-5)
    law = stroke_law(1e3, [(20e3, 0.1, 0.4)])
    assert law(np.array([0.0, 0.1])) == pytest.approx([1e3, 1e3])
    assert law(np.array([0.5])) == pytest.approx([20e3 - 0.02 * 19e3], rel=1e-5)


@pytest.mark.parametrize("derivative", [1, 2])
def test_the_law_and_its_derivatives_agree_and_are_continuous(derivative):
    law = stroke_law(0.0, [(20e3, 0.05, 0.4), (-5e3, 0.3, 0.2)])
    t, h = np.linspace(0.0, 0.6, 601), 1e-6
    numeric = (law(t + h, derivative - 1) - law(t - h, derivative - 1)) / (2 * h)
    exact = law(t, derivative)
    # the third derivative jumps at a stroke's start: the difference is off by h * jump / 4
    assert np.abs(numeric - exact).max() < 1e-3 * np.abs(exact).max()
    starts = np.array([0.05, 0.3])
    # the third derivative is some 2e8 Pa/s^3: 2 ns change the second by less than 1 Pa/s^2
    assert law(starts - 1e-9, 2) == pytest.approx(law(starts + 1e-9, 2), abs=2.0)


def test_a_measured_ramp_starts_from_rest_and_lags_by_half_of_the_smoothing(tmp_path):
    """Exactly: the average of a straight line, with a weight that is even about its middle."""
    path = tmp_path / "p.csv"
    path.write_text("t,p\n0,1000\n0.5,16000\n")
    law, t = measured_law(path, 0.04), np.array([-1.0, 0.0, 0.04, 0.3, 0.5, 0.54, 2.0])
    assert law(t) == pytest.approx([1e3, 1e3, 1.6e3, 9.4e3, 15.4e3, 16e3, 16e3], rel=1e-12)
    assert law(t, 1) == pytest.approx([0, 0, 30e3, 30e3, 30e3, 0, 0], abs=1e-6)
    assert law(t, 2) == pytest.approx(0 * t, abs=1e-4)
    with pytest.raises(StageError, match="at least 3 rows"):
        measured_law(path, 0.0)


def test_the_average_of_a_history_is_that_of_its_straight_lines(tmp_path):
    rng = np.random.default_rng(3)
    times, p = np.cumsum(rng.uniform(0.002, 0.03, 60)), 1e4 * rng.uniform(size=60)
    rows = "".join(f"{a!r},{b!r}\n" for a, b in zip(times.tolist(), p.tolist(), strict=True))
    (tmp_path / "p.csv").write_text("t,p\n" + rows)
    law, span, t, h = measured_law(tmp_path / "p.csv", 0.05), 0.05, np.linspace(0, 1.2, 241), 1e-5
    x = (np.arange(20000) + 0.5) / 20000
    weight = 140 * x**3 * (1 - x) ** 3 / len(x)
    wanted = [weight @ np.interp(at - span * x, times, p) for at in t]
    assert law(t) == pytest.approx(wanted, abs=0.1)  # Pa: kinks between the points of the sum
    for derivative in (1, 2):
        exact = law(t, derivative)
        numeric = (law(t + h, derivative - 1) - law(t - h, derivative - 1)) / (2 * h)
        # h² / 6 of the derivative after next, over the smoothing to the second power
        assert np.abs(numeric - exact).max() < 1e-5 * np.abs(exact).max()


def test_a_measured_history_passes_through_its_points_and_rests_outside(tmp_path):
    t = np.linspace(0, 0.4, 21)
    p = 20e3 * three_pole(t / 0.05)
    rows = "".join(f"{a},{b}\n" for a, b in zip(t, p, strict=True))
    (tmp_path / "p.csv").write_text("t,p\n" + rows)
    law = measured_law(tmp_path / "p.csv", 0.0)
    assert law(t) == pytest.approx(p, abs=1e-9)
    assert law(np.array([-1.0, 5.0])) == pytest.approx([p[0], p[-1]])
    assert law(np.array([-1.0, 5.0]), 1) == pytest.approx([0, 0])


@pytest.mark.parametrize(
    "pressure, gamma", [(-10e3, -1.0), (0.0, 0.0), (10e3, 1.0), (20e3, 2.0), (5e3, 0.5)]
)
def test_constant_curvature_is_reproduced_exactly(pressure, gamma):
    f = kinematics()
    assert f.bend(pressure) == pytest.approx(gamma, abs=1e-12)
    middle, along, dorsal = f.tip(pressure)
    radius = LENGTH / gamma if gamma else np.inf
    arc = [LENGTH, 0] if not gamma else [radius * np.sin(gamma), radius * (1 - np.cos(gamma))]
    # origin of the actuator frame: half a thickness dorsal of the start of the profile
    outwards = np.array([np.sin(gamma), -np.cos(gamma)])
    expected = np.array(arc) + [0, THICKNESS / 2] + THICKNESS / 2 * outwards
    # between states the pieces' angles are interpolated: a half-way circle is exact too
    assert middle == pytest.approx(expected, abs=1e-9)
    assert along == pytest.approx([np.cos(gamma), np.sin(gamma)], abs=1e-9)
    assert dorsal == pytest.approx([np.sin(gamma), -np.cos(gamma)], abs=1e-9)


def test_the_outline_encloses_the_strip_it_was_bent_from():
    f = kinematics()
    for p, gamma in ((0.0, 0.0), (20e3, 2.0)):
        x, y = f.outline(p).T
        area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
        corners = 4 * (1 - np.pi / 4) * 0.002**2
        exact = LENGTH * THICKNESS + 0.5 * gamma * THICKNESS**2 - corners
        assert abs(area) == pytest.approx(exact, rel=2e-3)  # a polygon of 480 points inside an arc
