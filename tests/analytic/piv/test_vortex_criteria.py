"""Gradients and vortex criteria on fields whose answers are known in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piv.vortices.criteria import gradients, q_criterion, swirling_strength, vorticity
from piv.vortices.lamb_oseen_fit import PEAK_RADIUS, lamb_oseen

X, Y = np.meshgrid(np.arange(41.0), np.arange(31.0))
ALL = np.ones(X.shape, bool)


@pytest.mark.parametrize("scheme", ["least-squares", "fourth-order"])
def test_linear_field_has_exact_gradients_up_to_every_border(scheme):
    u, v = 1 + 0.2 * X - 0.3 * Y, -2 + 0.5 * X + 0.1 * Y
    valid = ALL.copy()
    valid[10:20, 15:25] = False
    g = gradients(u, v, valid, 1.0, 1.0, scheme)
    for value, exact in zip(g, (0.2, -0.3, 0.5, 0.1), strict=True):
        # every stencil is exact for a straight line; 1e-12 leaves room for rounding
        np.testing.assert_allclose(value[valid], exact, atol=1e-12)
        assert np.isnan(value[~valid]).all()
    np.testing.assert_allclose(vorticity(g)[valid], 0.8, atol=1e-12)


def test_gradients_never_reach_across_a_body():
    valid = ALL.copy()
    valid[:, 20] = False  # one cell thick: the field jumps from side to side
    u = np.where(X < 20, 0.0, 1000.0)
    g = gradients(u, u, valid, 1.0, 1.0)
    np.testing.assert_allclose(g.dudx[valid], 0.0, atol=1e-12)


def test_solid_rotation_and_pure_shear():
    g = gradients(-0.5 * Y, 0.5 * X, ALL, 1.0, 1.0)
    np.testing.assert_allclose(swirling_strength(g), 0.5, atol=1e-12)
    np.testing.assert_allclose(q_criterion(g), 0.25, atol=1e-12)
    g = gradients(0.5 * X, -0.5 * Y, ALL, 1.0, 1.0)
    np.testing.assert_allclose(swirling_strength(g), 0.0, atol=1e-12)
    np.testing.assert_allclose(q_criterion(g), -0.25, atol=1e-12)


@given(
    drift=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    centre=st.tuples(st.floats(15, 25), st.floats(12, 18)),
    sense=st.sampled_from([-1, 1]),
)
@settings(max_examples=15, deadline=None)
def test_criteria_of_a_lamb_oseen_vortex(drift, centre, sense):
    u, v = lamb_oseen(X, Y, *centre, sense * 30.0, 5.0)
    g = gradients(u + drift[0], v + drift[1], ALL, 1.0, 1.0, "fourth-order")
    r = np.hypot(X - centre[0], Y - centre[1])
    swirl = sense * swirling_strength(g)
    inner = (X > 2) & (X < 38) & (Y > 2) & (Y < 28)
    # the swirling strength ends at the radius of peak swirl; half a cell for the discrete gradient
    assert (swirl[inner & (r < 5 * PEAK_RADIUS - 0.5)] > 0).all()
    assert (swirl[inner & (r > 5 * PEAK_RADIUS + 0.5)] == 0).all()
