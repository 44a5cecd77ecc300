"""From the unit cell to the finger: chain, circle, smoothing, outline, file, settings."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.fea.envelope import crosses_itself, outline
from pipeline.fea.finger import arc_length, chain, fit_circle, smoothed
from pipeline.formats.bending_states import BendingLaw, BendingStates, read, write


def arc(radius, length=0.07, points=80, turn=0.3):
    s = np.linspace(0, length, points)
    line = np.stack([radius * np.sin(s / radius), radius * (1 - np.cos(s / radius))], -1)
    return line @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]] + [0.01, -0.02]


@given(st.floats(0.009, 1.0), st.booleans(), st.floats(-3, 3))
def test_circle_of_an_exact_arc(radius, ventral, turn):
    signed = radius if ventral else -radius
    fitted_radius, residual = fit_circle(arc(signed, turn=turn))
    # rounding of a 70 mm arc of R = 1 m, whose sagitta is 0.6 mm
    assert fitted_radius == pytest.approx(signed, rel=1e-6)
    assert residual < 1e-9


def test_straight_line_has_an_infinite_radius():
    line = np.stack([np.linspace(0, 0.07, 50), np.linspace(0, 0.01, 50)], -1)
    assert fit_circle(line)[0] == np.inf


@given(st.floats(-0.2, 0.2).filter(lambda angle: abs(angle) > 1e-3))
def test_chained_cells_turn_by_their_angle(angle):
    """Cells bent to arcs: straight in the clamped half chamber, an arc beyond."""
    rest = np.linspace(0, 0.0045, 10)
    radius = 0.0045 / angle
    half = np.stack([radius * np.sin(rest / radius), -radius * (1 - np.cos(rest / radius))], -1)
    line = chain(half, angle, rest, 8, 0.0035)
    steps = np.diff(line, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    # 14 whole halves and 7/9 of the last, less half of the last chord's own turn
    assert heading[0] == pytest.approx(0, abs=1e-12)
    assert heading[-1] == pytest.approx((14 + 7 / 9 - 1 / 18) * angle, rel=1e-9)
    assert arc_length(line)[-1] == pytest.approx(0.070, rel=1e-3)  # chords are shorter than arcs
    np.testing.assert_allclose(line[0], 0, atol=1e-15)


def test_smoothing_keeps_a_polynomial_and_removes_ripple():
    s = np.linspace(0, 0.07, 126)
    clean = np.stack([s, 5 * s**2], -1)[None]
    ripple = 3e-5 * np.sin(2 * np.pi * s / 0.009)
    np.testing.assert_allclose(smoothed(clean, s), clean, atol=1e-12)
    rippled = clean + np.stack([np.zeros_like(s), ripple], -1)[None]
    inside = (s > 0.012) & (s < 0.058)  # at its ends a least-squares curve follows the last wave
    assert np.abs(smoothed(rippled, s) - clean)[:, inside].max() < 0.2 * 3e-5


def test_crossing_polygons_are_found():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    assert not crosses_itself(square)
    assert crosses_itself(square[[0, 2, 1, 3]])
    assert not crosses_itself(outline(arc(-0.03), np.full(80, 0.0165)))
    assert crosses_itself(outline(arc(-0.03), np.full(80, 0.035)))


def test_file_gives_back_what_was_written(tmp_path):
    each = np.array([4e-4, 5e-4, 6e-4])
    law = BendingLaw(
        stiffness=each, neutral_axis=5 * each, moment=np.array([-1e-3, 0.0]),
        curvature=np.ones((3, 2)), air_section=each / 5, air_height=10 * each, rubber_mass=0.3,
        rubber_section=3e-4, rubber_height=0.007, clamped_length=0.0035, stiffness_std=each / 10,
    )  # fmt: skip
    lines = np.array([arc(radius) for radius in (-0.05, 0.5, 0.05)])
    states = BendingStates(
        np.array([-1e4, 0.0, 1e4]), lines, np.full(lines.shape[:2], 0.0165), width=0.028,
        bend_angle=np.array([-1.4, 0.0, 1.4]), radius=np.array([-0.05, np.inf, 0.05]),
        radius_std=np.array([1e-3, np.inf, 1e-3]), fit_residual=np.zeros(3), law=law,
        converged=np.ones(3, np.uint8), about={"solver": "none", "settings": {"a": [1, 2]}},
    )  # fmt: skip
    write(tmp_path / "states.h5", states)
    again = read(tmp_path / "states.h5")
    for name in ("pressure", "profile", "thickness", "radius", "radius_std", "converged"):
        np.testing.assert_array_equal(getattr(again, name), getattr(states, name))
    for name, value in vars(law).items():
        np.testing.assert_array_equal(getattr(again.law, name), value)
    assert again.wall_gap is None
    assert {key: again.about[key] for key in states.about} == states.about
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize("turn", [-5.0, -3.0, -2.0, 1.57, 4.0])
def test_a_noisy_profile_turns_to_its_own_side(turn):
    """0.3 mm of noise on steps of 0.7 mm, as of a profile that was digitised by hand."""
    s = np.linspace(0, 0.07, 101)
    circle = np.stack([np.sin(turn * s / 0.07), 1 - np.cos(turn * s / 0.07)], -1) * 0.07 / turn
    noise = 3e-4 * np.random.default_rng(0).normal(size=circle.shape)
    radius, residual = fit_circle(circle + noise)
    assert radius == pytest.approx(0.07 / turn, rel=0.02)
    assert residual == pytest.approx(3e-4, rel=0.2)  # a tenth from 101 points, twice that


def test_circle_through_few_points_turns_the_right_way():
    for count in (3, 4, 5, 8):
        angle = np.linspace(0, 1.2, count)
        profile = 0.05 * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=-1)
        assert fit_circle(profile)[0] == pytest.approx(0.05, rel=1e-6)
