"""The middle of the stroke and the velocity scale."""

import numpy as np
import pytest
import xarray as xr

from postprocess.evidence.strokes import peak_tip_speed, progress, stroke_window


def test_window_is_in_fractions_of_bend():
    time = np.linspace(0, 1, 101)
    # linear in between
    assert stroke_window(time, 2 * time**2, (0.25, 0.81)) == pytest.approx((0.5, 0.9), abs=2e-4)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_window_does_not_depend_on_the_sense_of_bending(sign):
    time = np.linspace(0, 1, 101)
    assert stroke_window(time, 0.3 + sign * time, (0.25, 0.75)) == pytest.approx((0.25, 0.75))


def test_rest_before_and_after_and_the_way_back_do_not_count():
    time = np.linspace(0, 4, 401)
    bend = np.interp(time, [0, 1, 2, 3, 4], [0, 0, 1, 1, 0])
    assert stroke_window(time, bend, (0.25, 0.75)) == pytest.approx((1.25, 1.75))
    assert stroke_window(time, bend, (0.25, 1.0))[1] == 4.0


@pytest.mark.parametrize("instants", [0, 5])
def test_a_finger_that_does_not_bend_is_refused(instants):
    with pytest.raises(ValueError, match="does not move"):
        stroke_window(np.linspace(0, 1, instants), np.zeros(instants), (0.25, 0.75))


def test_peak_tip_speed_of_a_circular_motion():
    time = np.linspace(0, 1, 2001)
    angle = np.pi * (1 - np.cos(np.pi * time)) / 2  # fastest in the middle: π²/2 rad/s
    tip = 0.07 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[:, None]
    speed, at = peak_tip_speed(time, tip)
    assert speed == pytest.approx(0.07 * np.pi**2 / 2, rel=1e-5)  # central differences: (ω dt)²/6
    assert at == pytest.approx(0.5, abs=1e-3)


def test_a_body_that_does_not_turn_is_followed_by_its_distance():
    time = np.linspace(0, 1, 101)
    tip = np.stack([-0.3 * time, np.full_like(time, 0.2)], axis=-1)[:, None]
    bend = ("time", "finger"), np.zeros((101, 1))
    plane = xr.Dataset({"bend": bend, "tip": (("time", "finger", "axis"), tip)})
    assert progress(plane) == pytest.approx(0.3 * time)
    assert stroke_window(time, progress(plane), (0.25, 0.75)) == pytest.approx((0.25, 0.75))
    plane["bend"] = plane["bend"] + time[:, None]
    assert progress(plane) == pytest.approx(time)
