"""Differences of two plane series: known ones are recovered, equal series give zero."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piv.formats.plane_series import make_plane
from postprocess.evidence import fields
from softfinger.study.errors import near_tip_error

X, Y = np.linspace(-0.05, 0.05, 41), np.linspace(0.1, 0.2, 31)
TIME = np.array([0.0, 0.01, 0.02, 0.03])


def linear_series(x, y, time, *, gain=1.0, du=0.0, dv=0.0, hole=False):
    """u and v linear in x, y and t, so that linear interpolation is exact."""
    t, gy, gx = np.meshgrid(time, y, x, indexing="ij")
    u = gain * (0.1 + 2.0 * gx - 1.0 * gy + 3.0 * t) + du
    v = gain * (0.05 + 1.0 * gx + 0.5 * gy - 2.0 * t) + dv
    valid = np.ones(u.shape, bool)
    if hole:
        valid[:, 10:20, 10:20] = False
        u, v = np.where(valid, u, np.nan), np.where(valid, v, np.nan)
    return make_plane(x, y, u, v, time=time, valid=valid)


def test_identical_series_differ_by_nothing():
    plane = linear_series(X, Y, TIME, hole=True)
    sums = fields.field_sums(plane, plane)
    assert fields.rms_difference(sums) < 1e-15  # rounding of the grid coordinates alone
    # rounding of a quotient of sums
    assert fields.correlation(sums) == pytest.approx(1.0, abs=1e-12)
    assert (sums["points"] == plane["valid"].sum(("y", "x")).values).all()


def test_other_grid_and_other_times_are_interpolated_exactly():
    reference = linear_series(X, Y, TIME)
    other = linear_series(X[3:-3:2] + 0.0007, Y[2:-2:3] + 0.0004, 0.5 * (TIME[1:] + TIME[:-1]))
    # linear in x, y, t: rounding only
    assert fields.rms_difference(fields.field_sums(reference, other)) < 1e-14


@given(du=st.floats(-0.5, 0.5).filter(lambda d: abs(d) > 1e-6), dv=st.floats(-0.5, 0.5))
@settings(max_examples=20, deadline=None)
def test_a_uniform_offset_is_recovered(du, dv):
    reference, other = linear_series(X, Y, TIME, hole=True), linear_series(X, Y, TIME, du=du, dv=dv)
    sums = fields.field_sums(reference, other)
    assert fields.rms_difference(sums) == pytest.approx(np.hypot(du, dv), rel=1e-9)


def test_a_reversed_v_is_caught():
    reference = linear_series(X, Y, TIME)
    other = reference.assign(v=-reference["v"])
    sums = fields.field_sums(reference, other)
    u2, v2 = float((reference["u"] ** 2).sum()), float((reference["v"] ** 2).sum())
    assert fields.correlation(sums) == pytest.approx((u2 - v2) / (u2 + v2), rel=1e-12)
    apart = 2 * np.sqrt(v2 / reference["v"].size)
    assert fields.rms_difference(sums) == pytest.approx(apart, rel=1e-12)


@pytest.mark.parametrize("gain", [2.0, -1.0])
def test_a_gain_correlates_by_its_sign_and_differs_by_its_part_of_the_field(gain):
    reference, other = linear_series(X, Y, TIME), linear_series(X, Y, TIME, gain=gain)
    sums = fields.field_sums(reference, other)
    own = np.sqrt(float((reference["u"] ** 2 + reference["v"] ** 2).mean()))
    assert fields.correlation(sums) == pytest.approx(np.sign(gain), abs=1e-12)
    assert fields.rms_difference(sums) == pytest.approx(abs(gain - 1) * own, rel=1e-12)


def test_points_next_to_a_hole_do_not_count():
    reference = linear_series(X, Y, TIME, hole=True)
    other = linear_series(X[:-1] + np.diff(X) / 2, Y[:-1] + np.diff(Y) / 2, TIME)
    sums = fields.field_sums(reference, other)
    # cells that touch the 10 × 10 hole of nodes: 11 × 11 of the 30 × 40 cell centres
    assert (sums["points"] == 30 * 40 - 11 * 11).all()
    assert fields.rms_difference(sums) < 1e-14


def test_only_points_near_a_tip_count():
    """A change beyond two tip widths is no error near the tip; one within them is all of it."""
    tip = np.tile([[[0.01, 0.15]]], (len(TIME), 1, 1))
    reference = linear_series(X, Y, TIME).assign(tip=(("time", "finger", "axis"), tip))
    reference.attrs["tip_width"] = 0.01
    gx, gy = np.meshgrid(X, Y)
    near = np.hypot(gx - 0.01, gy - 0.15) <= 0.02
    for where, error in ((near, 0.1), (~near, 0.0)):
        gain = np.where(where, 1.1, 1.0)
        other = reference.assign(u=reference["u"] * gain, v=reference["v"] * gain)
        # linear in time: rounding alone
        assert near_tip_error(reference, other) == pytest.approx(error, abs=1e-12)


def test_order_of_convergence_of_the_interpolation_is_two():
    def swirl(x, y):
        gx, gy = np.meshgrid(x, y)
        return make_plane(x, y, np.sin(60 * gx)[None], np.cos(50 * gy)[None], time=np.zeros(1))

    at = swirl(np.linspace(-0.03, 0.03, 37), np.linspace(0.12, 0.18, 37))
    errors = []
    for n in (21, 41, 81):
        reference = swirl(np.linspace(-0.05, 0.05, n), np.linspace(0.1, 0.2, n))
        errors.append(fields.rms_difference(fields.field_sums(reference, at)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    # bilinear; sampling of the error at 37 points scatters a little
    assert orders == pytest.approx(2.0, abs=0.15)


def test_series_without_a_common_instant_are_refused():
    with pytest.raises(ValueError, match="share no instant"):
        fields.field_sums(linear_series(X, Y, TIME), linear_series(X, Y, TIME + 1.0))


def test_no_correlation_is_given_at_rest():
    plane = linear_series(X, Y, TIME)
    still = plane.assign(u=0 * plane["u"], v=0 * plane["v"])
    with pytest.raises(ValueError, match="at rest"):
        fields.correlation(fields.field_sums(still, still))
    series = fields.field_series(fields.field_sums(still, plane), 1e-3)
    assert series["velocity_correlation"].isna().all()
