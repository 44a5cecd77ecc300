"""V&V 20: verdicts, shares and the velocity field's limit against cases worked out by hand."""

import numpy as np
import pytest

from postprocess.lab.judgement.validation import (
    AGREES,
    ERROR,
    UNCERTAIN,
    FieldComparison,
    Source,
    ValidatedQuantity,
    coverage_factor,
    detectable_factor,
    joint_level,
)


def quantity(error: float, *stds: float, scale: float = 10.0) -> ValidatedQuantity:
    kinds = ("numerical", "input", "data")
    sources = [Source(f"s{k}", kinds[k % 3], np.array([s]), "") for k, s in enumerate(stds)]
    values = np.array([10 + error]), np.array([10 + error + 0.5]), np.array([10.0])
    return ValidatedQuantity("q", "q", "m", *values, scale, sources)


def test_sources_add_in_squares_and_the_largest_is_named():
    q = quantity(1.0, 0.3, 0.4, 1.2)
    assert q.u_val[0] == pytest.approx(1.3)
    assert q.u_kind("input")[0] == pytest.approx(0.4)
    assert q.dominant.name == "s2"
    assert q.measurement_part[0] == pytest.approx(0.5)


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
    assert quantity(error, std).verdict(too_uncertain=0.3) == word


def test_a_model_error_of_the_detectable_size_is_found_as_often_as_it_says():
    """3.605 of u_val for one quantity (Gaussian); drawn for two."""
    assert detectable_factor(1) == pytest.approx(1.95996 + 1.64485, abs=1e-3)
    rng = np.random.default_rng(4)
    size = detectable_factor(2, joint_level(7))
    drawn = rng.normal([size, 0.0], 1.0, (4000, 2))
    found = np.hypot(*drawn.T) > coverage_factor(2, joint_level(7))
    assert found.mean() == pytest.approx(0.95, abs=0.011)  # three standard errors of 4000 draws
    assert quantity(0.0, 0.6, 0.8).detectable() == pytest.approx(3.605, abs=1e-3)


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_a_share_of_the_error_raises_no_false_alarm_and_grows_with_the_error_to_be_found(share):
    """Without a model error the share is of nothing; with one it grows by it."""
    level, rng = joint_level(7), np.random.default_rng(6)
    far = np.array([unlike(e, share).significance() for e in rng.normal(0.0, 1.0, 20_000)])
    alarms = np.mean(far > coverage_factor(1, level))
    assert alarms == pytest.approx(1 - level, abs=0.0018)  # three standard errors of 20000 draws
    size = unlike(0.0, share).detectable(level)
    assert size > detectable_factor(1, level)
    drawn = rng.normal(size, np.hypot(1.0, share * size), 4000)
    found = np.mean([unlike(e, share).verdict(0.3, level) == ERROR for e in drawn])
    assert found == pytest.approx(0.95, abs=0.011)  # three standard errors of 4000 draws


def test_a_share_beyond_the_limit_lets_no_error_be_found_for_sure():
    """1 ± 0.61 of an error is measured: nothing is left in 5 %, at 1.645 standard uncertainties."""
    assert unlike(0.0, 0.61).detectable(joint_level(7)) == np.inf
    assert unlike(0.0, 0.61).verdict(0.3, joint_level(7)) == UNCERTAIN
    assert unlike(1e3, 0.61).verdict(0.3, joint_level(7)) == ERROR
    assert unlike(0.0, 0.3).verdict(0.3, joint_level(7)) == AGREES


def unlike(error: float, share: float) -> ValidatedQuantity:
    """A quantity of 100 with a standard uncertainty of 1, and a share of E."""
    part = np.array([share * abs(error)])
    sources = [Source("s", "data", np.ones(1), ""), Source("unlike flows", "data", part, "", share)]
    ours = np.array([100 + error])
    return ValidatedQuantity("q", "q", "m", ours, ours, np.array([100.0]), 100.0, sources)


def test_what_the_data_know_better_than_the_inputs_differs():
    inside = quantity(1.0, 0.1, 2.0, 0.2)  # numerical, input, data
    assert inside.verdict(too_uncertain=10.0) == AGREES
    assert inside.differs()
    assert not quantity(0.3, 0.1, 2.0, 0.2).differs()


def test_two_components_are_judged_together():
    source = Source("s", "data", np.array([1.0, 1.0]), "")
    values = np.array([2.2, 1.0]), np.zeros(2), np.zeros(2)
    near = ValidatedQuantity("c", "c", "m", *values, 100.0, [source])
    assert coverage_factor(2) == pytest.approx(2.4477, abs=1e-4)
    assert near.verdict(0.5) == AGREES  # 2.2 alone would be beyond 1.96
    assert joint_level(7) == pytest.approx(0.95 ** (1 / 7))


@pytest.mark.parametrize("error, share", [(0.0, 0.05), (1.0, 0.95)])
def test_field_limit_is_exceeded_as_often_as_it_says(error, share):
    """Without a model error, and with one (sinusoidal) of the detectable size."""
    rng, shape = np.random.default_rng(3), (3, 2, 24, 30)
    pattern = np.sin(0.7 * np.arange(np.prod(shape))).reshape(shape)
    wave = 0.7 * np.sin(np.arange(np.prod(shape))).reshape(shape)
    modes = {"a": ("input", wave), "b": ("data", np.full(shape, 0.3))}
    noise = np.full(shape, 0.5)
    field = FieldComparison(np.zeros(shape), modes, noise)
    limit = field.allowed_rms()
    size = error * field.detectable() / np.sqrt(np.mean(np.sum(pattern**2, axis=1)))
    beyond = 0
    for _ in range(600):
        e = size * pattern + sum(rng.standard_normal() * m for _, m in modes.values())
        e += noise * rng.standard_normal(shape)
        beyond += FieldComparison(e, modes, noise).rms() > limit
    assert beyond / 600 == pytest.approx(share, abs=0.027)  # three standard errors of 600 draws


def test_absent_vectors_count_nowhere():
    error = np.ones((2, 2, 4, 5))
    error[0, :, 1, 1] = np.nan
    field = FieldComparison(error, {"a": ("input", 0.5 * error)}, np.ones(error.shape))
    assert field.rms() == pytest.approx(np.sqrt(2))
    assert np.isnan(field.significance()[0, 1, 1])
    assert field.parts()["a"] == ("input", pytest.approx(0.5 * np.sqrt(2)))
