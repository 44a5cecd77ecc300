"""Pictures: names that can be read, and scales that no outlier sets."""

import numpy as np
import pandas as pd
import pytest

from piv.formats.plane_series import make_plane
from postprocess.draw.flow import flow_figure, format_instant, others, view_limits
from postprocess.evidence.time_windows import Clock
from postprocess.report.flow_figures import tip_vortices
from tests.synthetic_stroke import finger_series


def plane_of(bend_deg):
    """A minimal plane series for drawing: a finger in a wide tank."""
    finger = finger_series(np.radians(bend_deg))
    x, y = np.linspace(-0.3, 0.3, 61), np.linspace(0.0, 0.3, 31)
    u = np.zeros((len(bend_deg), y.size, x.size))
    return make_plane(x, y, u, u, time=np.array([0.0, 0.1]), valid=np.ones(u.shape, bool), **finger)


def test_the_angle_is_that_of_the_instant_and_not_of_the_nearest_frame():
    plane = plane_of([0.0, 40.0])
    assert format_instant(plane, 0.06) == "0.060 s, bent by 24°"


def test_what_is_not_judged_is_marked_where_it_is_strong():
    rows = {"time": [0.1] * 4 + [0.2, 0.2, 0.3], "track": [1, 2, 3, 4, 5, 1, 1]}
    rows |= {"circulation": [1.0, -0.9, 0.4, 0.05, 9.0, 1.0, 1.0]}
    table = pd.DataFrame(rows | dict.fromkeys(("x", "y", "radius"), 0.0))
    judged = [table[(table["track"] == 1) & (table["time"] < 0.25)]]
    assert list(others(table, judged, 0.1)["track"]) == [2, 3]
    assert list(others(table, judged, 0.3)["track"]) == [1]  # judged no more
    assert others(table, judged, 0.15).empty


def test_panels_show_the_finger_and_its_vortex_and_not_the_empty_tank():
    plane = plane_of([0.0, 40.0])
    x0, x1, y0, y1 = view_limits({"cfd": plane}, {})
    whole = plane["outline"].values.reshape(-1, 2)
    assert x0 < whole[:, 0].min() < whole[:, 0].max() < x1 <= float(plane["x"][-1])
    assert y0 < whole[:, 1].min() < whole[:, 1].max() < y1 <= float(plane["y"][-1])
    assert x1 - x0 <= np.ptp(whole[:, 0]) + 0.041


def test_no_mark_in_a_hole_of_the_vectors():
    plane = plane_of([0.0, 40.0])
    plane["valid"][:, 10:14, 40:44] = 0
    hole = (float(plane["x"][42]), float(plane["y"][12]))
    water = (float(plane["x"][50]), float(plane["y"][12]))
    row = {"time": [0.0, 0.1], "radius": 0.01, "circulation": 1e-3}
    places, view = enumerate((hole, water)), (-0.3, 0.3, 0.0, 0.3)
    tracks = [pd.DataFrame(row | {"track": k, "x": x, "y": y}) for k, (x, y) in places]
    shown = ({"cfd": tracks[:count]} for count in range(3))
    drawn = [flow_figure({"cfd": plane}, each, 0.1, 1.0, view)(0.1) for each in shown]
    assert (drawn[0] == drawn[1]).all()
    assert (drawn[1] != drawn[2]).any()


@pytest.mark.parametrize(
    "back, starts, last",
    [
        (2.0, (0.0, 0.5), 2),  # there and back
        (2.0, (0.0, 0.5, 1.2), 2),  # a stroke that begins after the end
        (0.0, (0.0, 0.5), 1),  # a stroke to the same pressure
    ],
)
def test_each_stroke_that_moves_shows_the_vortex_of_its_own(back, starts, last):
    time = np.linspace(0.0, 1.0, 101)
    bend = np.where(time < 0.5, 2 * time, 1 - back * (time - 0.5))
    clock = Clock(time, bend, starts=starts)
    rows = {"x": 0.0, "y": 0.0, "radius": 0.01, "finger": 0, "side": "", "tip_distance": 1.0}
    first = pd.DataFrame({"time": time, "track": 1, "circulation": -2.0} | rows)
    second = pd.DataFrame({"time": time[40:], "track": 2, "circulation": 3.0} | rows)
    table = pd.concat([first, second], ignore_index=True)
    (shown,) = tip_vortices(plane_of([0.0, 40.0]), {"cfd": table}, clock, (0.6, 0.9))["cfd"]
    assert (shown["track"] == np.where(shown["time"] < 0.5 - 1e-9, 1, last)).all()
    assert len(shown) == 101
