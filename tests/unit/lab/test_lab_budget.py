"""V&V 20: verdicts against cases worked out by hand, and the errors that go into them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from postprocess.lab.dpiv_toml import Start
from postprocess.lab.fit_outline import pose_of, state_of
from postprocess.lab.flow import excess_scatter, independent_instants, place_jacobian
from postprocess.lab.pose import Pose
from postprocess.lab.register import MAX_FRAMES, Fit, Known, register, stated_registration
from postprocess.lab.validation import (
    AGREES,
    DIFFERS,
    ERROR,
    UNCERTAIN,
    Source,
    ValidatedQuantity,
    coverage_factor,
    detectable_factor,
    joint_level,
    judged,
)


def quantity(error: float, *stds: float, scale: float = 10.0) -> ValidatedQuantity:
    kinds = ("numerical", "input", "data")
    sources = [Source(f"s{k}", kinds[k % 3], np.array([s]), "") for k, s in enumerate(stds)]
    values = np.array([10 + error]), np.array([10.0])
    return ValidatedQuantity("q", "q", "m", *values, scale, sources)


@pytest.mark.parametrize(
    "error, std, word",
    [
        (1.5, 0.8, AGREES),
        (1.6, 0.8, ERROR),
        (1.0, 0.9, UNCERTAIN),
        (9.0, 2.0, ERROR),
        (0.0, np.nan, UNCERTAIN),
    ],
)
def test_verdict_is_that_of_the_band(error, std, word):
    assert quantity(error, std).verdict() == word


def test_a_model_error_of_the_detectable_size_is_found_as_often_as_it_says():
    """3.605 of u_val for one quantity (Gaussian); drawn for two."""
    assert detectable_factor(1) == pytest.approx(1.95996 + 1.64485, abs=1e-3)
    rng = np.random.default_rng(4)
    size = detectable_factor(2, joint_level(7))
    drawn = rng.normal([size, 0.0], 1.0, (4000, 2))
    found = np.hypot(*drawn.T) > coverage_factor(2, joint_level(7))
    assert found.mean() == pytest.approx(0.95, abs=0.011)  # three standard errors of 4000 draws
    assert quantity(0.0, 0.6, 0.8).detectable() == pytest.approx(3.605, abs=1e-3)


def test_what_the_data_know_better_than_the_inputs_differs():
    inside = quantity(1.0, 0.1, 2.0, 0.2)  # numerical, input, data
    assert inside.dominant.name == "s1"
    assert inside.significance(inside.u_kind("data")) == pytest.approx(5.0)
    # a bend that differs is not undecided as well
    assert judged(replace(inside, name="final_bend"))["verdict"] == DIFFERS
    within = quantity(0.3, 0.1, 2.0, 0.2, scale=100.0)
    assert replace(within, name="final_bend").verdict() == AGREES


def test_two_components_are_judged_together():
    source = Source("s", "data", np.array([1.0, 1.0]), "")
    values = np.array([2.2, 1.0]), np.zeros(2)
    near = ValidatedQuantity("c", "c", "m", *values, 100.0, [source])
    assert coverage_factor(2) == pytest.approx(2.4477, abs=1e-4)
    assert near.verdict() == AGREES  # 2.2 alone would be beyond 1.96
    assert joint_level(7) == pytest.approx(0.95 ** (1 / 7))


@pytest.mark.parametrize("angle", [0.03, 1.6])
def test_place_moves_with_the_pose_as_its_jacobian_says(angle):
    pose, place = Pose(1 / 4.0, angle, (0.01, 0.245), (310.0, 460.0)), np.array([0.03, 0.19])
    seen = pose.to_px(place)
    jacobian = place_jacobian(pose, place)
    for k, step in enumerate((1e-2, 1e-2, 1e-5, 1e-5)):
        change, state = step * np.eye(8)[k], state_of(pose, np.ones(3))
        there, back = (pose_of(state + s * change, pose.anchor).to_tank(seen) for s in (1, -1))
        slope = (there - back) / (2 * step)
        np.testing.assert_allclose(jacobian[:, k], slope, rtol=1e-6, atol=1e-10)


@pytest.mark.parametrize(
    "crossed, pairs",
    [(0.0, 25), (0.25, 5 + 8 * 0.75 + 6 * 0.5 + 4 * 0.25), (0.5, 5 + 8 * 0.5), (2.0, 5)],
)
def test_instants_are_independent_once_the_particles_have_left_the_window(crossed, pairs):
    """Five instants: 25 over the sum of their correlations."""
    window_s = 0.03
    assert independent_instants(np.arange(5) * crossed * window_s, window_s) == pytest.approx(
        25 / pairs
    )


@pytest.mark.parametrize(
    "scale_std, length_std, scale, std",
    [
        (0.01, 0.0, 1.00297, 0.000995),  # the finger is as long as it should be: it tells the scale
        (0.003, 0.003, 1.00142, 0.00218),  # about half of it each
        (0.0003, 0.003, 1.00003, 0.0003),  # a good calibration is not moved by the finger
    ],
)  # fmt: skip
def test_what_is_stated_sharpens_what_the_pictures_show(scale_std, length_std, scale, std):
    """A finger of uncertain length that shows a scale 0.3 % larger to 0.1 %."""
    stated = Pose(1 / 4.0, 0.0, (0.0, 0.245), (310.0, 460.0))
    state = state_of(replace(stated, scale_mm_per_px=1.003 / 4.0), np.array([1.0, 0.02, 1.0]))
    fit = Fit(
        [], np.zeros(1), 0.01, state, np.diag([0.1, 0.1, 1e-3, 1e-3, 0.1, 0.01, 0.02, 0.01]) ** 2,
        np.zeros(1), np.zeros((4, 1)), np.zeros((4, 1)), SimpleNamespace(rate=lambda: 0.05),
    )  # fmt: skip
    known = Known(stated, scale_std, delay=(0.0, 0.02), length_std=length_std)
    registration = register(fit, SimpleNamespace(root=stated.anchor), known)
    assert 4.0 * registration.pose.scale_mm_per_px == pytest.approx(scale, abs=1e-5)
    assert np.sqrt(registration.covariance[3, 3]) == pytest.approx(std, rel=0.02)
    assert registration.covariance[1, 1] == pytest.approx(0.1**2)
    assert registration.law.delay == pytest.approx(0.01)  # as well stated as seen


def test_vectors_are_registered_as_stated():
    axes = SimpleNamespace(x="left", root_mm=(30.0, 40.0), root_std_mm=0.5, turn_deg=90.0,
                           turn_std_deg=1.8)  # fmt: skip
    dpiv = SimpleNamespace(
        axes=axes, start=Start(at_s=0.2, std_s=0.01), scale=SimpleNamespace(std_percent=1.0)
    )
    made = stated_registration(dpiv, SimpleNamespace(root=(0.0, 0.245)))
    assert made.pose == Pose(1e3, np.pi / 2, (0.0, 0.245), (-0.03, 0.04))
    stds = np.sqrt(np.diag(made.covariance))
    np.testing.assert_allclose(stds, [5e-4, 5e-4, np.radians(1.8), 0.01])
    assert made.times.size == made.pressures.size == 0
    np.testing.assert_array_equal(made.law.values, [1.0, -0.2, 1.0])
    np.testing.assert_array_equal(made.law.covariance, np.diag([0.0, 0.01**2, 0.0]))
    told = made.summary()
    assert (told["delay_ms"], told["delay_std_ms"]) == pytest.approx((-200, 10))
    assert [*told["root_std_mm"], told["turn_deg"]] == pytest.approx([0.5, 0.5, 90])


def test_of_pairs_the_first_pictures_are_chosen_from_the_first_to_the_last():
    known = Known(Pose(1.0, 0.0, (0.0, 0.0), (0.0, 0.0)), 0.01)
    np.testing.assert_array_equal(known.chosen(7), range(7))
    np.testing.assert_array_equal(replace(known, paired=True).chosen(7), [0, 2, 4, 6])
    many = known.chosen(1000)
    assert (many[0], many[-1]) == (0, 999)
    assert len(many) == MAX_FRAMES


def test_scatter_that_the_vectors_do_not_know_is_found():
    rng = np.random.default_rng(1)
    times = np.linspace(0.1, 0.2, 400)
    trend = np.column_stack([3 + 40 * times, -5 * times])  # a growing error is no scatter
    error = trend + rng.normal(0, [5.0, 0.3], (400, 2))
    scatter = excess_scatter(times, error, np.array([3.0, 0.4]) ** 2)
    assert scatter == pytest.approx([4.0, 0.0], rel=0.1)
    assert excess_scatter(times[:2], error[:2], np.zeros(2)) == pytest.approx([0.0, 0.0])
