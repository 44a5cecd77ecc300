"""Grid convergence on data made with a known order and limit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from docs.evidence.validation.convergence import estimate, least_squares, three_grids

SIZES = np.array([1.0, 1.4, 2.2, 3.0])


@given(
    order=st.floats(0.6, 3.0),
    limit=st.floats(-5, 5),
    slope=st.floats(0.05, 2) | st.floats(-2, -0.05),
    ratios=st.tuples(st.floats(1.3, 2.0), st.floats(1.3, 2.0)),
)
@settings(max_examples=60, deadline=None)
def test_three_grids_recover_order_and_limit(order, limit, slope, ratios):
    size = np.cumprod([0.5, *ratios])
    fit = three_grids(size, limit + slope * size**order)
    # exact data: the error is rounding, amplified by differences of nearly equal values
    assert fit.order == pytest.approx(order, rel=1e-5)
    assert fit.extrapolated == pytest.approx(limit, abs=1e-4)


@pytest.mark.parametrize("order", [0.7, 1.0, 1.5, 2.0])
def test_least_squares_recover_order_and_limit(order):
    fit = least_squares(SIZES, 3.0 - 0.2 * SIZES**order)
    assert fit.order == pytest.approx(order, abs=1e-4)
    assert fit.extrapolated == pytest.approx(3.0, abs=1e-4)
    # the safety factor times the distance, and nothing else, where the fit is exact
    assert fit.uncertainty == pytest.approx(1.25 * 0.2 * SIZES**order, rel=1e-3)


def test_an_order_beyond_the_schemes_is_not_trusted():
    fit = estimate(SIZES, 1.0 + 0.01 * SIZES**4)
    assert fit.order is None
    assert fit.kind in ("h", "h²")
    assert (fit.uncertainty > 3 * np.abs(1.0 + 0.01 * SIZES**4 - fit.extrapolated)).all()


def test_mixed_first_and_second_order_is_covered_by_the_uncertainty():
    value = 2.0 + 0.1 * SIZES - 0.05 * SIZES**2
    fit = estimate(SIZES, value)
    assert (np.abs(value - 2.0) <= fit.uncertainty).all()


def test_noise_beyond_the_spread_widens_the_uncertainty():
    rng = np.random.default_rng(3)
    covered = []
    for _ in range(200):
        value = 1.0 + 0.01 * SIZES**2 + rng.normal(scale=0.01, size=4)
        covered.append(abs(value[0] - 1.0) <= estimate(SIZES, value).uncertainty[0])
    assert np.mean(covered) > 0.9  # meant as 95 %


def test_values_that_oscillate_have_no_order_but_an_uncertainty():
    with pytest.raises(ValueError, match="do not converge"):
        three_grids(SIZES[:3], np.array([1.0, 1.1, 0.9]))
    fit = estimate(SIZES[:3], np.array([1.0, 1.1, 0.9]))
    assert (fit.uncertainty > 0.05).all()


def test_grids_are_counted():
    with pytest.raises(ValueError, match="three of each"):
        three_grids(SIZES, SIZES)
    with pytest.raises(ValueError, match="at least three"):
        least_squares(SIZES[:2], SIZES[:2])
