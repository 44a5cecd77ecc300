"""Time at which the ventral pair forms, relative to contact and to the remaining gap."""

import numpy as np
import pandas as pd
import pytest

from postprocess.compare.pinch_summary import integral_numbers
from postprocess.evidence.pair_integrals import COLUMNS
from postprocess.evidence.time_windows import Clock

TIMES = np.arange(0.0, 1.0, 0.008)
MET = 0.6  # s
RESIDUAL = 0.002  # m


def pair_at(times, circulation):
    rows = [
        [time, "ventral", "upward", finger, sign * size, -0.001, 0.2, 0.002, 0.1]
        for time, size in zip(times, np.broadcast_to(circulation, times.shape), strict=True)
        for finger, sign in ((0, 1), (1, -1))
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def numbers(there, circulation=1e-3):
    gap = np.maximum(RESIDUAL + 0.1 * (MET - TIMES), RESIDUAL)
    clock = Clock(TIMES, TIMES, TIMES, gap, RESIDUAL)
    return integral_numbers(TIMES, pair_at(TIMES[there], circulation), clock, MET, 0.0167)


def test_a_pair_of_the_opening_stroke_is_not_that_of_closing():
    found = numbers((TIMES > 0.05) & (TIMES < 0.2) | (TIMES >= 0.5))
    assert found["ventral_forms_time"] == pytest.approx(0.504)  # the first instant from 0.5 s on
    assert found["ventral_forms_gap"] == pytest.approx(RESIDUAL + 0.1 * (MET - 0.504))


def test_a_pair_may_form_after_contact():
    found = numbers(TIMES >= 0.65)
    assert found["ventral_forms_time"] == pytest.approx(0.656)
    assert found["ventral_forms_gap"] == pytest.approx(RESIDUAL)


def test_no_pair_no_numbers():
    found = numbers((TIMES > 0.05) & (TIMES < 0.2))
    assert found["ventral_forms_time"] is None
    assert found["ventral_circulation_peak"] is None


def test_a_pair_that_still_grows_where_the_window_ends_has_no_peak():
    since = TIMES[TIMES >= 0.65]
    growing = numbers(TIMES >= 0.65, since)
    assert growing["ventral_forms_time"] == pytest.approx(0.656)
    assert growing["ventral_circulation_peak"] is None
    assert growing["ventral_part"] is None
    fading = numbers(TIMES >= 0.65, np.where(since < 0.88, since, 0.5))
    assert fading["ventral_circulation_peak_time"] == pytest.approx(0.872)
    assert fading["ventral_circulation_peak"] == pytest.approx(0.872)
