"""V&V 20: verdicts and limits against cases worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

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


def test_sources_add_in_squares_and_the_largest_is_named():
    q = quantity(1.0, 0.3, 0.4, 1.2)
    assert q.u_val[0] == pytest.approx(1.3)
    assert q.u_kind("input")[0] == pytest.approx(0.4)
    assert q.dominant.name == "s2"


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
