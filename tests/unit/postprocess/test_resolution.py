"""Limits of an agreement follow what the recording can resolve."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from postprocess.compare.findings import is_met, read_findings
from postprocess.compare.resolution import resolution, widened
from postprocess.compare.stage import _AGREEMENT, QUANTITIES
from postprocess.draw.series import Curve, over_time
from postprocess.report.picture_index import time_axis

FINDINGS = {f.quantity: f for f in read_findings(_AGREEMENT, frozenset(QUANTITIES))}


def scene(rate_hz: float = 500.0):
    """A camera of 0.125 mm/px."""
    camera = SimpleNamespace(frame_rate_hz=rate_hz, pixel=1.25e-4)
    return SimpleNamespace(camera=camera, piv=SimpleNamespace(window=32))


def core(radius: float) -> pd.DataFrame:
    return pd.DataFrame({"radius": [radius]})


def test_a_recording_that_moves_enough_keeps_the_limits():
    seen = resolution(scene(), core(4e-3), 0.3125)  # 5 px
    assert seen.displacement_px == pytest.approx(5.0)
    assert seen.factor("velocity_rms_difference") == seen.factor("circulation_difference") == 1.0
    assert seen.cure == ""


def test_a_slow_flow_widens_them_and_names_the_frame_rate_that_cures_it():
    seen = resolution(scene(), core(4e-3), 0.04375)  # 0.7 px
    assert seen.factor("velocity_rms_difference") == pytest.approx(5 / 0.7)
    assert "at most 0.7 px of displacement; set camera.frame_rate_hz = 70 " in seen.cure
    wide = widened(FINDINGS["velocity_rms_difference"], 5 / 0.7)
    assert is_met(wide, 0.2)
    assert not is_met(wide, 0.25)
    alike = widened(FINDINGS["velocity_correlation"], 2.0)
    assert is_met(alike, 0.91)
    assert not is_met(alike, 0.89)


def test_a_core_smaller_than_half_a_window_concerns_the_vortex_alone():
    seen = resolution(scene(), core(1e-3), 0.5)  # window: 4 mm
    assert seen.factor("velocity_rms_difference") == 1.0
    assert seen.factor("circulation_difference") == pytest.approx(2.0)
    assert "set piv.window = 16" in seen.cure


def test_an_axis_ignores_a_spike_and_names_it_and_the_page_knows_where_its_time_is():
    time = np.linspace(0, 1, 101)
    force = np.sin(time)
    force[1] = 50.0
    figure = over_time([("force, mN", [Curve(time, force)])])
    axes = figure.axes[0]
    assert axes.get_ylim()[1] < 1
    assert [text.get_text().strip() for text in axes.texts] == ["▲ to 50"]
    figure.canvas.draw()
    left, right, first, last, above, below = time_axis(figure)["axis"]
    assert 0 < left < right <= 1
    assert 0 <= above < 1 - below < 1  # the time's labels are below
    assert first <= 0 < 1 <= last
