"""Choice and comparison of the tip vortex."""

import numpy as np
import pandas as pd
import pytest

from postprocess.evidence import tip_vortex as tracks
from tests.synthetic_stroke import vortex_table

BEND = np.radians(100)
TIME = np.linspace(0, 0.4, 81)
WINDOW = (0.1, 0.2)


def chosen(table):
    return tracks.dominant_track(table, 0, WINDOW, "test")


def test_the_strong_vortex_at_the_tip_is_chosen():
    assert (chosen(vortex_table(TIME, BEND))["track"] == 3).all()


def test_a_stronger_vortex_far_from_the_tip_is_not_chosen():
    table = vortex_table(TIME, BEND)
    table.loc[table["track"] == 1, "circulation"] = 1.0
    assert (chosen(table)["track"] == 3).all()


def test_a_strong_flicker_is_not_chosen():
    table = vortex_table(TIME, BEND)
    row = table[(table["track"] == 3) & table["time"].between(*WINDOW)].iloc[[0]].assign(track=9)
    row["circulation"] *= 3
    table = tracks.pd.concat([table, row], ignore_index=True)
    assert (chosen(table)["track"] == 3).all()


def test_no_vortex_near_the_tip_is_an_error_that_says_where():
    table = vortex_table(TIME, BEND)
    with pytest.raises(ValueError, match=r"finger 0 between 0\.100 and 0\.200 s"):
        chosen(table[table["track"] == 1])


@pytest.mark.parametrize("gain", [0.9, 1.0, 1.07, -1.0])
@pytest.mark.parametrize("shift", [0.0, -2e-3])
def test_known_errors_of_circulation_and_centre_are_recovered(gain, shift):
    reference = chosen(vortex_table(TIME, BEND))
    middle = 0.5 * (TIME[1:] + TIME[:-1])
    other = chosen(vortex_table(middle, BEND, gain=gain, shift=shift))
    pair = tracks.within(tracks.pair_tracks(reference, other), WINDOW)
    # 5 ms between instants: linear interpolation of a growth over 50 ms errs by (5/50)²/8 ≈ 0.1 %
    assert tracks.relative_difference(pair, "circulation") == pytest.approx(abs(gain - 1), abs=2e-3)
    assert tracks.centre_distance(pair) == pytest.approx(abs(shift), abs=3e-5)


def test_vortices_that_never_coexist_are_refused():
    track = chosen(vortex_table(TIME, BEND))
    pair = tracks.pair_tracks(track, track[track["time"] > 0.3])
    with pytest.raises(ValueError, match="do not exist together"):
        tracks.within(pair, WINDOW)


def test_the_same_vortex_is_compared_where_two_of_one_sense_share_a_tip():
    """Reference: the stronger vortex is far from that of the other source, a weaker one near."""

    same = {"y": 0.0, "radius": 3e-3, "peak_vorticity": -100.0, "finger": 0, "tip_distance": 1.0}
    same |= {"time": [0.1, 0.15, 0.2], "side": "dorsal"}

    def rows(track, x, circulation):
        return pd.DataFrame(same | {"track": track, "x": x, "circulation": circulation})

    places = [rows(0, 0.02, 6e-3), rows(1, 0.0, 5e-3), rows(2, 0.001, 1e-3)]
    reference = pd.concat(places, ignore_index=True)
    seen = rows(7, 0.001, 4.9e-3)
    window = (0.1, 0.2)
    # track 2 is the nearest, but too weak to be the strongest of the other source
    assert set(tracks.counterpart(reference, seen, 0, window)["track"]) == {1}
    tables = tracks.dominant_tracks({"cfd": reference, "piv": seen}, 0, window)
    assert set(tables["cfd"]["track"]) == {1}
    assert set(tables["piv"]["track"]) == {7}


def known_window(instants, least=0.0, std=0.0):
    """Of a flow that has its vortex over TIME, and of PIV that has it at some `instants` (s)."""
    flow = chosen(vortex_table(TIME, BEND))
    seen = flow[np.isclose(flow["time"].to_numpy()[:, None], instants).any(axis=1)]
    seen = seen.assign(circulation_std=std * seen["circulation"].abs())
    return tracks.known_window({"cfd": flow, "piv": seen}, (0.0, 0.4), least)


def test_a_window_of_few_instants_is_not_judged():
    """Two instants of PIV's own choice were a window."""
    flow = chosen(vortex_table(TIME, BEND))["time"].to_numpy()
    first, span = flow[0], np.ptp(flow)
    assert known_window(flow[[4, -1]]) is None
    assert known_window(flow[4:8]) is None  # four instants, in a twentieth of the stroke
    assert known_window(flow[:: len(flow) // 4]) is not None
    third = flow[flow - first <= 0.36 * span]
    assert known_window(third) == pytest.approx((first, third[-1]))
    assert known_window(flow[flow - first <= 0.3 * span]) is None
    assert known_window(third, least=0.5 * span) is None
    # where the circulation is known nowhere, the centres are compared
    assert known_window(third, std=0.2) == pytest.approx((first, third[-1]))
