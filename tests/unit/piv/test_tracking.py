"""Tracks of vortices."""

from dataclasses import replace

import numpy as np
import pytest

from piv.formats.plane_series import make_plane, provenance
from piv.vortices.table import fastest
from piv.vortices.tip_frame import place_at_tip
from piv.vortices.tracking import Tracker
from piv.vortices.vortex import Vortex

PLAIN = Vortex(0, 0, 1.0, np.nan, 1.0, 0.1, 1.0, 1.0, *[0.01] * 18)


def at(x: float, y: float, circulation: float = 1.0) -> Vortex:
    return replace(PLAIN, x=x, y=y, circulation_disc=circulation)


def test_crossing_vortices_of_equal_sense_keep_their_numbers():
    tracker = Tracker()
    for k in range(41):
        s = (k - 20) * 0.25
        numbers = tracker.update(0.002 * k, [at(s, 0.4), at(-s, -0.4)][:: 1 if k % 2 else -1])
        numbers = numbers if k % 2 else numbers[::-1]
        if k == 0:
            first = numbers
        assert numbers == first


def test_a_gap_is_bridged_and_a_long_one_is_not():
    tracker = Tracker()
    for k in range(6):
        assert tracker.update(float(k), [at(0.3 * k, 0)]) == [0]
    for k in (6, 7):
        assert tracker.update(float(k), []) == []
    assert tracker.update(8.0, [at(2.4, 0)]) == [0]
    for k in range(9, 14):
        tracker.update(float(k), [])
    assert tracker.update(14.0, [at(4.2, 0)]) == [1]


@pytest.mark.parametrize(
    "other, fastest, same",
    [
        (at(0.6, 0), 1.0, True),
        (at(1.3, 0), 0.2, False),  # the flow carries it by 0.2, its radius is 1
        (at(0.1, 0, 0.3), 1.0, False),  # less than a third is left
        (at(0.1, 0, 0.4), 1.0, True),
        (at(0.1, 0, -1.0), 1.0, False),
        (replace(at(0.1, 0, np.nan), at_edge=True), 1.0, False),
    ],
)
def test_a_track_never_goes_on_with_another_vortex(other, fastest, same):
    tracker = Tracker()
    assert tracker.update(0.0, [at(0, 0)], fastest) == [0]
    assert tracker.update(1.0, [other], fastest) == [0 if same else 1]


@pytest.mark.parametrize(
    "unit, attrs, speed",
    [
        ("frame", provenance(pairing="1-2,2-3", skip=1), 1.5),  # 3 px in two frames
        ("frame", provenance(pairing="1-2,3-4", skip=0), np.inf),  # the pairs' distance is unknown
        ("frame", {}, np.inf),
        ("s", provenance(pairing="1-2,3-4", skip=0) | {"interval": 0.5}, 6.0),
    ],
)
def test_the_largest_speed_is_known_of_vectors_in_px(unit, attrs, speed):
    """Tracks were limited by it in m/s alone."""
    plane = make_plane(np.arange(3.0), np.arange(3.0), np.full((3, 3), 3.0), np.zeros((3, 3)))
    plane = plane.assign_coords(time=((), 0.0, {"units": unit})).assign_attrs(attrs)
    for name in ("x", "y", "u", "v"):
        plane[name].attrs["units"] = "px"
    assert fastest(plane) == speed


def test_a_vortex_at_the_edge_is_followed_on_a_track_of_its_own():
    tracker, gone = Tracker(), replace(at(0.1, 0, np.nan), at_edge=True, x_std=np.nan)
    tracker.update(0.0, [at(0, 0)])
    assert tracker.update(1.0, [gone]) == tracker.update(2.0, [replace(gone, x=0.2)]) == [1]


def test_numbers_are_never_used_twice_and_time_must_ascend():
    tracker = Tracker()
    assert tracker.update(0.0, [at(0, 0), at(50, 0)]) == [0, 1]
    assert tracker.update(1.0, [at(100, 0), at(0, 0)]) == [2, 0]
    with pytest.raises(ValueError, match="ascending times"):
        tracker.update(1.0, [])


def test_place_in_the_frame_of_the_nearest_tip():
    u = np.zeros((4, 4))
    plane = make_plane(
        np.arange(4), np.arange(4), u, u,
        tip=np.array([[0.0, 0.0], [1.0, 0.0]]),
        tip_direction=np.array([[0.0, -1.0], [0.0, -1.0]]),
        dorsal_direction=np.array([[-1.0, 0.0], [1.0, 0.0]]),
    ).assign_attrs(tip_width=0.1)  # fmt: skip
    place = place_at_tip(1.3, 0.4, plane)
    assert place is not None
    assert (place.finger, place.side) == (1, "dorsal")
    assert (place.along_tip, place.across_tip) == pytest.approx((-0.4, 0.3))
    assert place.tip_distance == pytest.approx(5)
    assert place_at_tip(0.2, 0.1, plane).side == "ventral"
    assert place_at_tip(0.2, 0.1, plane.drop_vars("tip")) is None
