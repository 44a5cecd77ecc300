"""Every quantity of a finding on tables and planes whose answers follow by hand.

Values outside the window are wild, and no two of mean, median, RMS and maximum agree.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from piv.formats.plane_series import make_plane
from postprocess.compare.quantities import QUANTITIES
from postprocess.evidence.evidence import Evidence, Part
from postprocess.evidence.pair_integrals import COLUMNS
from postprocess.evidence.time_windows import Clock

TIME = np.arange(1, 8) / 10  # s
WINDOW = (0.15, 0.65)  # holds five instants
WIDTH, SCALE = 0.01, 0.5  # m, m/s


def one_finger():
    """A finger that moves on from two columns after two: the water behind rises and sinks."""
    x, y = np.arange(10) * WIDTH, np.arange(4) * WIDTH
    left = np.array([0, 2, 5, 5, 5, 5, 5])  # first column in the finger
    outline = np.array([[[(a - 0.4, -1), (a + 1.4, -1), (a + 1.4, 4), (a - 0.4, 4)]] for a in left])
    inside = (np.arange(10) >= left[:, None]) & (np.arange(10) <= left[:, None] + 1)
    valid = np.repeat(~inside[:, None], 4, axis=1)
    v = np.broadcast_to([9, 9, 0.3, -0.1, *[9.0] * 6], valid.shape).copy()
    v[[0, 6]] = 9.0
    return make_plane(x, y, 0 * v, v, time=TIME, valid=valid, outline=WIDTH * outline)


def two_fingers():
    """Boxes on both sides of x = 0; the flow parts at 0.055 m at three of the five instants."""
    x, y = np.arange(-4, 5) * WIDTH, np.arange(10) * WIDTH
    box = WIDTH * np.array([[-4.5, 4.5], [-2.5, 4.5], [-2.5, 20.0], [-4.5, 20.0]])
    up = np.where(x > 1.5 * WIDTH, -0.4, 0.4)  # at one of five columns between the fingers
    down = np.where(x > 0.5 * WIDTH, 0.3, -0.3)  # at one of three within a tip width
    v = np.where(y[:, None] > 0.055, up, down)
    v[y < 0.035] = 9.0  # below two tip widths
    v = np.repeat(v[None], 7, axis=0)
    v[[0, 4, 5, 6]] = 9.0  # before, after, and where the flow does not part
    fingers = {"outline": np.stack([box, box * [-1, 1]]), "tip": np.zeros((2, 2))}
    fingers |= {"dorsal_direction": np.array([[-1.0, 0.0], [1.0, 0.0]])}
    fingers = {name: np.repeat(f[None], 7, axis=0) for name, f in fingers.items()}
    return make_plane(x, y, np.full_like(v, 0.3), v, time=TIME, **fingers)


def table(time, **columns):
    return pd.DataFrame({"time": time} | columns)


SEEN = [0.1, 0.2, 0.3, 0.4, 0.5, 0.7]
STRONG = 1e-3 * np.array([-9, -4, -5, -6, -9, -20])  # in the window: mean -6


def vortices(circulation, std, x, y):
    """The tip's vortex at SEEN, and a rival at two instants of the window."""
    strong = table(
        SEEN, track=1, circulation=circulation, circulation_std=std, x=x, y=y, finger=0,
        tip_distance=[2.4, 0.5, 0.6, 0.7, 1.4, 2.0], side=["ventral"] * 2 + ["dorsal"] * 4,
    )  # fmt: skip
    rival = table(
        [0.2, 0.3], track=2, circulation=-3e-3, circulation_std=0.0, x=0.5, y=0.5, finger=0,
        tip_distance=1.0, side="ventral",
    )  # fmt: skip
    return pd.concat([strong, rival], ignore_index=True)


CFD = vortices(STRONG, 0.0, 0.0, 0.0)
PIV = vortices(
    STRONG + 1e-3 * np.array([9, 1, -1, 2, 5, 9]),
    [0, 0, 0, 0, 1e-3, 0],  # at 0.5 s a quarter of the circulation: not known
    1e-3 * np.array([90, 0, 3, 0, 0, 90]),
    1e-3 * np.array([90, 0, 4, 0, 5, 90]),
)
SUMS = table(
    [0.1, 0.2, 0.3, 0.7], points=[9, 10, 30, 9], difference2=[99, 0.4, 3.2, 99],
    reference2=[99, 4, 5, 99], other2=[99, 10, 6, 99], product=[-99, 1, 5, -99],
)  # fmt: skip
PAIRS = table(
    [0.1, 0.2, 0.3, 0.4, 0.7],
    circulation_0=-1e-2, circulation_1=1e-2,
    circulation_std_0=0.0, circulation_std_1=[0, 0, 0, 1e-3, 0],  # 10 % at 0.4 s: not known
    imbalance=[9, 0.3, 0.4, 0.8, 9], mirror_distance=1e-3 * np.array([90, 1, 2, 2, 90]),
    across_tip_0=1e-2 * np.array([9, 0.2, 0.3, 0.4, 9]) - 2e-3,
    across_tip_1=1e-2 * np.array([9, 0.2, 0.3, 0.4, 9]) - 4e-3,
)  # fmt: skip
# the same bends as the pinch's, at other times
BENDS = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
ALONE = table(10 * BENDS, bend=BENDS, track=0, finger=0, tip_distance=1.0, circulation=-1e-2,
              across_tip=1e-2 * BENDS)  # fmt: skip
LINES = table(TIME, stagnation_y=[0.055, 0.055, 0.055, 0.055, np.nan, np.nan, 0.055],
              jet_speed=[9, 0.1, 0.4, 0.2, 0.1, 0.3, 9])  # fmt: skip


def integrals():
    """Rows of COLUMNS: a ventral pair at three instants, and a dorsal one that sinks and parts."""
    rows = []

    def add(time, side, flow, finger, strength, x=0.0, y=0.0, between=0.0):
        rows.append([time, side, flow, finger, strength, x, y, 0.004, between])

    rises = {0.3: (0.1, 0.3), 0.4: (0.2, 0.4), 0.5: (0.3, 0.5)}  # of the left, of the right finger
    for time, both in rises.items():
        for finger, between in enumerate(both):
            add(time, "ventral", "upward", finger, 5e-3, between=between)
    add(0.6, "ventral", "upward", 0, 5e-3, between=9.0)  # alone: no pair
    for time, strength in ((0.2, 5e-3), (0.5, 6e-3)):  # two of five instants
        add(time, "ventral", "downward", 0, strength)
    for time in (0.1, 0.7):
        for finger in (0, 1):
            add(time, "ventral", "upward", finger, 0.9, between=9.0)
    sinks = {0.2: 0.050, 0.3: 0.052, 0.4: 0.047, 0.5: 0.045, 0.6: 0.044}
    parts = {0.2: 0.020, 0.3: 0.019, 0.4: 0.023, 0.5: 0.024, 0.6: 0.025}
    for time in sinks:
        strength = 1e-2 if time < 0.45 else 1e-3  # the strongest at three of five instants
        for finger, sign in ((0, -1), (1, 1)):
            add(time, "dorsal", "downward", finger, strength, sign * parts[time], sinks[time])
    return pd.DataFrame(rows, columns=list(COLUMNS))


CLOCK = Clock(TIME, TIME, TIME, 0.02 - 0.03 * TIME, residual_gap=0.001, starts=(0.0, 0.15, 0.6))
TWO = two_fingers().assign_attrs(tip_width=WIDTH)
PLANES = {"cfd": one_finger().assign_attrs(tip_width=WIDTH), "pinch": TWO}
EVIDENCE = Evidence(
    PLANES, {"cfd": CFD, "piv": PIV}, SCALE, CLOCK, {"piv-cfd": SUMS}, {"pinch": PAIRS},
    {"pinch": LINES}, {"pinch": integrals()}, {"pinch": ALONE},
)  # fmt: skip
# of each quantity: what it is measured of, and its answer
ANSWERS = {
    "dominant_side": ("cfd", "dorsal"),
    "dominant_sense": ("cfd", "clockwise"),
    "rival_fraction": ("cfd", 6 / 24),
    "tip_distance": ("cfd", 0.8),
    "track_coverage": ("cfd", 4 / 5),
    "circulation_difference": ("piv-cfd", np.sqrt((1 + 1 + 4) / (16 + 25 + 36))),
    "centre_distance": ("piv-cfd", 5e-3 / np.sqrt(2)),
    "centre_distance_relative": ("piv-cfd", 0.5 / np.sqrt(2)),
    "velocity_rms_difference": ("piv-cfd", np.sqrt(3.6 / 40) / SCALE),
    "velocity_correlation": ("piv-cfd", 6 / np.sqrt(9 * 16)),
    "trace_upward_velocity": ("cfd", 0.1 / SCALE),
    "trace_upward_share": ("cfd", 0.5),
    "pair_side": ("pinch", "dorsal"),
    "pair_senses": ("pinch", "opposite"),
    "pair_imbalance": ("pinch", np.sqrt((0.09 + 0.16) / 2)),
    "pair_mirror_distance": ("pinch", np.sqrt(3) * 1e-3),
    "ventral_pair_share": ("pinch", 3 / 5),
    "ventral_pair_flow": ("pinch", "upward"),
    "ventral_pair_rise": ("pinch", 0.3 / SCALE),
    "ventral_pair_gap": ("pinch", 0.02 - 0.03 * 0.3 - 0.001),
    "pair_coverage": ("pinch", 3 / 5),
    "ventral_shift": ("pinch", 3e-3),
    "vortex_descent": ("pinch", 6e-3),
    "dorsal_drift": ("pinch", 5e-3),
    "parting_share": ("pinch", 3 / 5),
    "jet_peak": ("pinch", 0.4 / SCALE),
    "rise_share": ("pinch", 4 / 5),
    "rise_angle": ("pinch", np.arctan(0.3 / 0.4)),
    "fall_share": ("pinch", 2 / 3),
    "fall_angle": ("pinch", np.pi / 4),
}
KNOWN = {"circulation_difference": (3, 4), "pair_imbalance": (2, 3)}  # instants, of how many


@pytest.mark.parametrize("name", QUANTITIES)
def test_a_quantity_gives_the_answer_that_follows_by_hand(name):
    assert name in ANSWERS, f"add to ANSWERS what {name} is measured of, and its answer by hand"
    of, answer = ANSWERS[name]
    part = Part(EVIDENCE, of, WINDOW)
    measured = QUANTITIES[name].measure(part)
    assert measured == (answer if isinstance(answer, str) else pytest.approx(answer, rel=1e-9))
    known = QUANTITIES[name].known
    assert (known and known(part)) == KNOWN.get(name)


def test_a_vortex_without_another_near_the_tip_has_no_rival():
    alone = replace(EVIDENCE, vortices={"cfd": CFD[CFD["track"] == 1]})
    assert QUANTITIES["rival_fraction"].measure(Part(alone, "cfd", WINDOW)) == 0.0


def test_without_strokes_the_trace_begins_with_the_run():
    """At 0.1 s the finger was in two more columns, where the water rises."""
    early = replace(EVIDENCE, clock=replace(CLOCK, starts=()))
    share = QUANTITIES["trace_upward_share"].measure(Part(early, "cfd", WINDOW))
    assert share == pytest.approx((2 + 4 * 3) / (2 + 4 * 4))  # at 0.2 s, and at four instants
