"""The park of own fingers: its table makes scenes, and what exceeds a limit fails."""

import json
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest

from docs.evidence.park import table as park
from docs.evidence.park.checks import (
    LIMITS,
    Outcome,
    _against_whole,
    _clear,
    _contours,
    _nearest_within,
)
from docs.evidence.park.draw import drawn
from pipeline.scene.scene import load_scene

TABLE = {e["name"]: e for e in tomllib.loads(park.TABLE.read_text(encoding="utf-8"))["scene"]}


@pytest.mark.parametrize("name", ["pinch_45", "imported_30", "obstacle_70", "long_120"])
def test_an_entry_is_a_scene(name, tmp_path):
    entry, folder = TABLE[name], tmp_path / name
    park.new(entry, folder)
    scene = load_scene(folder, park.LEVEL)
    time, pressure = park.pressure(entry["pressure"])
    assert scene.motion.end_time >= time[-1]
    # a sensor's noise is no more than 1 %
    assert np.abs(pressure).max() == pytest.approx(1e3 * entry["pressure"]["kpa"][0], rel=0.02)
    assert scene.coupled is entry.get("coupled", True)
    assert (scene.pinch is not None) is ("pinch" in entry.get("extends", ""))
    assert bool(scene.obstacle) is ("obstacle" in entry.get("keys", ""))


def test_drawn_scenes_depend_on_their_seed_alone():
    assert drawn(1) == drawn(1) != drawn(2)


def test_what_exceeds_its_limit_fails():
    good = {name: limit.most for name, limit in LIMITS.items()}
    assert Outcome(good, "").failed() == []
    for name in LIMITS:
        assert Outcome(good | {name: 1.01 * good[name] + 1e-3}, "").failed() == [name]
        assert Outcome(good | {name: float("nan")}, "").failed() == [name]
        assert Outcome(good | {name: "no vortex"}, "").failed() == []
        # nothing passes for want of a number
        assert Outcome(good | {name: None}, "").failed() == [name]
        assert Outcome({k: v for k, v in good.items() if k != name}, "").failed() == [name]
        assert LIMITS[name].reason
    assert Outcome({}, "the mesh is bad").failed() == ["page"]


@pytest.mark.parametrize("sums", [[0.1, np.nan], [np.nan, 0.1]])
def test_a_sum_that_is_no_number_fails_at_whichever_instant_it_is(sums):
    """The largest of Python was that of the others, unless the first one was NaN."""
    found = np.array([[2.0, 1.0], [0.1, 0.0]])  # the second vortex is too young
    view, total = _against_whole(found, np.array(sums))
    assert view == 0.5
    assert np.isnan(total)
    assert _against_whole(found, np.array([0.1, 0.3])) == (0.5, 0.15)
    assert isinstance(_against_whole(found, np.array([]))[1], str)


def test_contours_of_the_total_lie_between_what_is_reached_and_the_tank():
    """One far cell off the wall they passed through its layer: the total was 8 % for 0.4 %."""
    reached, water = np.array([(-0.01, 0.09), (0.06, 0.21)]), np.array([(-0.25, 0.0), (0.25, 0.23)])
    for corners in _contours(reached, water):
        low, high = corners.min(0), corners.max(0)
        share = np.concatenate([(low - water[0]) / (reached[0] - water[0]),
                                (high - water[1]) / (reached[1] - water[1])])  # fmt: skip
        assert np.ptp(share) < 1e-9
        assert 0.299 < share[0] < 0.501


def test_a_contour_that_a_vortex_reaches_is_no_measure_of_the_total():
    """A vortex that came near a wall of a narrow tank made the total 12 % of it."""
    contour = np.array([(0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.0, 0.1)])
    places = {0.05: True, 0.079: True, 0.082: False, 0.118: False, 0.121: True}
    for x, clear in places.items():
        assert _clear(contour, SimpleNamespace(x=x, y=0.05, radius=0.01)) is clear


def test_a_vortex_at_the_lid_is_at_no_edge_of_the_view():
    """A pair that rose between two fingers stayed below the lid: no view shows more of it."""
    picture, water = np.array([(-0.1, 0.1), (0.1, 0.273)]), np.array([(-0.2, 0.0), (0.2, 0.27)])
    places = np.array([(0.0, 0.26), (0.0, 0.11), (-0.09, 0.2), (0.09, 0.2)])
    assert _nearest_within(places, picture, water).tolist() == [False, True, True, True]


def test_the_page_holds_what_was_made_and_what_failed(tmp_path):
    good = {name: limit.most for name, limit in LIMITS.items()} | {"cpu_s": 12.0}
    runs = {"coupled": Outcome(good, ""), "prescribed, PIV=0": Outcome({}, "the mesh is bad")}
    drawn_ = {"coupled, PIV=0": Outcome(good | {"total": 0.2}, "")}
    good_ = {"coupled, PIV=0": Outcome(good, "")}
    of_seeds = {"drawn_3_1": drawn_, "drawn_3_2": {}, "drawn_5_1": good_}
    for name, found in ({"cycle_90": runs} | of_seeds).items():
        (tmp_path / name).mkdir()
        kept = {motion: {"values": o.values, "ended": o.ended} for motion, o in found.items()}
        (tmp_path / name / "outcomes.json").write_text(json.dumps(kept))
    text = park.page(list(TABLE.values()), tmp_path)
    made = park.rows(list(TABLE.values()), tmp_path)
    assert list(made.iloc[0, :4]) == ["cycle_90", "coupled", "0.05", "0"]
    assert list(made.iloc[1, :3]) == ["cycle_90", "prescribed, PIV=0", "no page: the mesh is bad"]
    # one without any run has not passed
    assert "Of the 3 that were made of seed 3, 5, 1 passed all checks." in text
    assert f"{LIMITS['total'].about}: **0.2**" in text
    assert all(limit.reason in text for limit in LIMITS.values())


def test_costs_are_compared_with_the_speed_of_the_machine_taken_out(tmp_path):
    good = {name: limit.most for name, limit in LIMITS.items() if name != "cost"}
    for name, share in {"cycle_90": 0.5, "quick_35": 0.6, "sine_60": 0.9}.items():
        (tmp_path / name).mkdir()
        values = good | {"of_predicted": share, "commit": f"of_{name}"}
        kept = {"coupled": {"values": values, "ended": ""}}
        (tmp_path / name / "outcomes.json").write_text(json.dumps(kept))
    made = park.rows(list(TABLE.values()), tmp_path)
    column = next(name for name in made if name.startswith(LIMITS["cost"].about))
    assert made[column].to_list() == ["1.2", "1", "1.5"]
    text = park.page(list(TABLE.values()), tmp_path)
    assert "took 0.60 of the predicted" in text
    assert "of_cycle_90, of_quick_35, of_sine_60" in text
