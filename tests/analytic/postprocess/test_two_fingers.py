"""Two fingers with known flow: vortex pairs, parting line, region between, time windows."""

import numpy as np
import pandas as pd
import pytest

from piv.formats.plane_series import make_plane
from postprocess.evidence import centreline
from postprocess.evidence import vortex_pairs as pairs
from postprocess.evidence.time_windows import Clock, Window, interval, read_window

TIP = np.array([-0.01, 0.18])
WIDTH = 0.014


def vortex(time, finger, x, y, circulation, track=0, distance=0.5):
    return {
        "time": time, "finger": finger, "x": x, "y": y, "circulation": circulation,
        "track": track or finger, "radius": 0.004, "side": "dorsal", "tip_distance": distance,
        "along_tip": 0.001, "across_tip": 0.002 * (1 + time),
    }  # fmt: skip


def test_a_mirrored_pair_is_exact_and_known_errors_come_out():
    rows = [vortex(0.1, 0, -0.02, 0.17, -1e-2), vortex(0.1, 1, 0.02, 0.17, 1e-2)]
    rows += [vortex(0.2, 0, -0.02, 0.17, -1e-2), vortex(0.2, 1, 0.023, 0.166, 0.98e-2)]
    rows += [vortex(0.3, 0, -0.02, 0.17, -1e-2)]  # alone: no pair
    # the pair is followed as far as it goes
    rows += [vortex(0.4, 0, -0.02, 0.17, -1e-2), vortex(0.4, 1, 0.02, 0.17, 1e-2, distance=9.0)]
    table = pairs.pair_vortices(pd.DataFrame(rows), (0.0, 1.0))
    assert table["time"].tolist() == [0.1, 0.2, 0.4]
    assert table["imbalance"].tolist() == pytest.approx([0.0, 0.02 / 0.99, 0.0])
    assert table["mirror_distance"].tolist() == pytest.approx([0.0, 5e-3, 0.0])
    assert pairs.senses(table) == "opposite"


def test_cores_that_overlap_are_no_pair():
    rows = []
    for time, x in ((0.1, 2.1e-3), (0.2, 1.9e-3)):
        rows += [vortex(time, f, s * x, 0.17, s * 1e-2) for f, s in ((0, -1), (1, 1))]
    assert pairs.pair_vortices(pd.DataFrame(rows), (0.0, 1.0))["time"].tolist() == [
        0.1
    ]  # core radius 4 mm


def test_the_partner_is_the_mirror_image_not_the_strongest():
    rows = [vortex(0.1, 0, -0.02, 0.17, -1e-2), vortex(0.1, 1, 0.02, 0.17, 0.9e-2)]
    rows += [vortex(0.1, 1, 0.01, 0.20, -0.95e-2, track=5)]
    table = pairs.pair_vortices(pd.DataFrame(rows), (0.0, 1.0))
    assert table["circulation_1"].item() == 0.9e-2
    assert table["circulation_0"].item() == -1e-2


def test_a_pair_does_not_go_on_with_other_vortices():
    """The dorsal pair ends at 0.2 s; one of the other sense, weaker and higher, lasts."""
    rows = []
    for time in (0.1, 0.2, 0.3):
        for finger, side in ((0, -1), (1, 1)):
            if time < 0.3:
                rows.append(vortex(time, finger, side * 0.02, 0.17, side * 2e-2, finger))
            rows.append(vortex(time, finger, side * 0.02, 0.22, -side * 1.2e-2, 2 + finger))
    table = pairs.pair_vortices(pd.DataFrame(rows), (0.0, 0.25))
    assert table["time"].tolist() == [0.1, 0.2]
    assert (table["circulation_0"] < 0).all()


def test_equal_senses_are_told():
    rows = [vortex(0.1, 0, -0.02, 0.17, 1e-2), vortex(0.1, 1, 0.02, 0.17, 1e-2)]
    table = pairs.pair_vortices(pd.DataFrame(rows), (0.0, 1.0))
    assert pairs.senses(table) == "equal"
    assert table["imbalance"].item() == pytest.approx(2.0)


def test_shift_is_taken_at_equal_bend_not_at_equal_time():
    bend = np.linspace(0.2, 1.2, 11)
    single = pd.DataFrame({"across_tip": 0.010 * bend})
    pair = pd.DataFrame({"across_tip_0": 0.010 * bend - 2e-3, "across_tip_1": 0.010 * bend - 4e-3})
    for shown in (slice(None), slice(3, 8)):
        shift = pairs.shift_at_equal_bend(pair[shown], bend[shown], single, bend, "across_tip")
        assert shift == pytest.approx(-3e-3, abs=1e-12)
    with pytest.raises(ValueError, match="no common bend"):
        pairs.shift_at_equal_bend(pair, bend + 2.0, single, bend, "across_tip")


def stagnation_plane(spacing=0.002, height=0.171, rate=2.0, offset=0.0):
    """u = −k x, v = k (y − height) between two upright fingers; `offset` shifts the columns."""
    x = np.arange(-0.06, 0.0601, spacing) + offset
    y = np.arange(0.10, 0.2401, spacing)
    gx, gy = np.meshgrid(x, y)
    box = np.array([[-0.034, 0.245], [-0.034, 0.18], [-0.020, 0.18], [-0.020, 0.245]])
    outline = np.stack([box, box * [-1, 1]])[None]
    inside = (np.abs(np.abs(gx) - 0.027) <= 0.007) & (gy >= 0.18)
    u, v = (np.where(inside, np.nan, field)[None] for field in (-rate * gx, rate * (gy - height)))
    return make_plane(
        x, y, u, v, time=np.array([0.5]), outline=outline, bend=np.zeros((1, 2)),
        p=np.where(inside, np.nan, 100 * (0.2 - gy))[None],
        tip=np.array([[[-0.027, 0.18], [0.027, 0.18]]]),
        tip_direction=np.array([[[0.0, -1.0], [0.0, -1.0]]]),
        dorsal_direction=np.array([[[-1.0, 0.0], [1.0, 0.0]]]),
    ).assign_attrs(tip_width=WIDTH)  # fmt: skip


@pytest.mark.parametrize("offset", [0.0, 0.0007])
def test_the_flow_parts_where_it_does(offset):
    plane = stagnation_plane(offset=offset)
    line = centreline.centreline(plane, 0.1).iloc[0]
    assert line["stagnation_y"] == pytest.approx(0.171, abs=1e-9)
    assert (line["jet_speed"], line["jet_y"]) == pytest.approx((2.0 * 0.071, 0.10))
    assert (line["rise_speed"], line["rise_y"]) == pytest.approx((2.0 * (0.24 - 0.171), 0.24))
    # at 0.174, the lowest node within half a width of the tips
    assert line["pressure_gap"] == pytest.approx(100 * 0.026)


def test_share_and_angle_of_a_stagnation_flow_are_exact():
    plane = stagnation_plane(spacing=0.001)
    lines = centreline.centreline(plane, 0.1)
    share, angle = centreline.oblique_flow(plane, lines, (0.4, 0.6), above=True)
    # between the fingers: |x| < 0.020, 0.180 <= y <= 0.240
    assert share == 1.0
    assert np.tan(angle) == pytest.approx(0.010 / (0.21 - 0.171), rel=0.03)
    share, angle = centreline.oblique_flow(plane, lines, (0.4, 0.6), above=False)
    assert share == 1.0
    assert np.tan(angle) == pytest.approx(0.5, rel=0.05)


def test_streams_below_the_noise_part_nothing():
    y = np.linspace(0.1, 0.2, 101)
    noise = 1e-3 * np.sin(y * 3e3)
    assert np.isnan(centreline.parting_height(noise, y, 0.15, 0.002))
    flow = 0.05 * np.tanh((y - 0.16) / 0.01) + noise
    assert centreline.parting_height(flow, y, 0.15, 0.002) == pytest.approx(0.16, abs=1e-3)
    # from up to down is a collision, no parting
    assert np.isnan(centreline.parting_height(-flow, y, 0.15, 0.002))


def test_a_plane_that_does_not_reach_between_the_fingers_is_refused():
    plane = stagnation_plane().sel(x=slice(-1, -0.01))
    with pytest.raises(ValueError, match="without the plane between the fingers"):
        centreline.centreline(plane, 0.1)


TIME = np.linspace(0, 1, 1001)
GAP = np.maximum(0.0405 - 0.08 * TIME, 0.0005)
CLOCK = Clock(TIME, np.minimum(TIME, 0.5), TIME, GAP, residual_gap=0.0005, starts=(0.0, 0.6))


@pytest.mark.parametrize(
    "value, expected",
    [
        ([0.2, 0.5], (0.1, 0.25)),
        ({"gap": [0.0205, 0.0105]}, (0.25, 0.375)),
        ({"contact": [-0.1, 0.2]}, (0.39875, 0.69875)),  # 0.1 mm above the residual gap
        ({"stroke": 1, "after": [0.1, 0.2]}, (0.7, 0.8)),
        ({"stroke": 0, "part": [0.2, 0.5]}, (0.1, 0.25)),
    ],
)
def test_windows(value, expected):
    assert interval(read_window(value), CLOCK) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    "value, told",
    [
        ({"gap": [0.005, 0.020]}, "falling"),
        ({"contact": [0.1, 0.1]}, "rising"),
        ({"part": [0.2, 0.5]}, "must be one of"),
        ({"stroke": 0, "gap": [0.02, 0.01]}, "must be one of"),
        ({"gap": [0.02, 0.01], "contact": [0, 1]}, "must be one of"),
        ("middle", "must be one of"),
        ([0.5, 0.2], "rising"),
        ({"stroke": -1, "after": [0, 1]}, "counted from 0"),
    ],
)
def test_windows_that_are_none_are_refused(value, told):
    with pytest.raises(ValueError, match=told):
        read_window(value)


def test_a_gap_that_is_never_reached_and_a_single_finger_are_told():
    with pytest.raises(ValueError, match=r"never come within 0\.4 mm"):
        interval(Window("gap", (0.01, 0.0004)), CLOCK)
    with pytest.raises(ValueError, match="one finger"):
        interval(Window("contact", (0.0, 0.1)), Clock(TIME, TIME))
    with pytest.raises(ValueError, match="2 strokes"):
        interval(Window("after", (0.0, 0.1), 2), CLOCK)
