"""The study of the pinch's jet: streams and vortices of known flows."""

import numpy as np
import pytest

from fileio.formats.plane_series import make_plane
from tests.studies.pinch_jet import dorsal_vortex, order, stream, summit

STEP = 0.5e-3
X = np.arange(-80, 81) * STEP


def test_stream_is_that_round_the_middle():
    """Of a cosine's half wave L = 20.3 mm wide, which ends between samples, and beside which water rises and sinks again: 2 L v / π and L v² / 2."""
    length = 0.0203
    down = 0.3 * np.cos(np.pi * X / length)
    speed, width, flux, momentum = stream(down, X)
    # the sums end half a step beyond the last sample, 0.175/0.5 of a step too far at 2 % of the speed: 6e-4 and less;
    # beside its zero a sine is straight to (π/40)²/6 = 1e-3 of a step
    assert speed == pytest.approx(0.3)
    assert width == pytest.approx(length, abs=2e-3 * STEP)
    assert flux == pytest.approx(2 * length * 0.3 / np.pi, rel=1e-3)
    assert momentum == pytest.approx(length * 0.3**2 / 2, rel=1e-3)


def test_stream_reaches_half_a_step_towards_a_body():
    down = np.where(np.abs(X) < 4.2 * STEP, 0.1, np.nan)
    assert stream(down, X)[1] == pytest.approx(9 * STEP)


def test_summit_is_that_of_the_parabola():
    values = 1 - (np.arange(5) - 2.3) ** 2
    assert summit(values, 2) == pytest.approx(0.3)
    assert summit(values, 1) == 0  # a larger one beside it


def test_no_stream_where_water_rises_on_the_middle():
    assert stream(-0.3 * np.cos(np.pi * X / 0.02), X) == (0, 0, 0, 0)


def test_dorsal_vortex_is_the_counter_clockwise_one_of_the_right_half_below_the_tips():
    """Two Gaussian vortices of 80 cm²/s, mirror images, 3 mm in radius, 10 mm from the middle."""
    y = np.arange(100, 181) * STEP
    xx, yy = np.meshgrid(X, y)
    u, v = np.zeros((2, *xx.shape))
    for x0, circulation in ((0.010, 8e-3), (-0.010, -8e-3)):
        dx, dy = xx - x0, yy - 0.070
        square = np.maximum(dx**2 + dy**2, 1e-12)
        swirl = circulation / (2 * np.pi * square) * (1 - np.exp(-square / 3e-3**2))
        u, v = u - swirl * dy, v + swirl * dx
    plane = make_plane(X, y, u[None], v[None], time=np.array([0.0])).assign_attrs(tip_width=0.0167)
    found = dorsal_vortex(plane, 0, 0.085)
    # of the errors of derivatives over 1 mm round the core only the positive half is counted: below 1 %
    assert found[0] == pytest.approx(8e-3, rel=0.01)
    assert found[1:] == pytest.approx((0.010, 0.070), abs=0.1 * STEP)


def test_order_is_that_of_the_differences():
    assert order([1 + (2 / 3) ** (2 * k) for k in range(3)]) == "2.0"
    assert order([0.268, 0.316, 0.422]) == "none"
