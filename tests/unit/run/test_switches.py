"""What run.json says of a switch between two legs, from tables made up for it."""

import json

import numpy as np
import pytest

from fileio.formats.mesh_intervals import Leg, run_in_steps
from pipeline.run.map_fields import SWITCH
from pipeline.run.mapping_error import settling_time, switches

STEP = 1e-3


def table(first, last, *columns):
    time = STEP * np.arange(first, last + 1)
    return np.column_stack([time, *(column(time) for column in columns)])


def test_a_force_settles_where_it_stays_near_the_old_one():
    before = table(0, 20, np.sin)
    after = table(13, 40, np.sin)
    start = 12 * STEP
    assert settling_time(before, after, start, 1.0) == 0.0
    after[:3, 1] += [0.5, -0.1, 0.03]
    assert settling_time(before, after, start, 1.0) == pytest.approx(
        4 * STEP
    )  # 0.03 is still off, by 2 % of the peak
    assert settling_time(before, after, start, 2.0) == pytest.approx(3 * STEP)
    after[7, 1] += 0.1  # the last that both solved
    assert settling_time(before, after, start, 1.0) is None


def test_a_switch_is_recorded_where_both_legs_were_solved(tmp_path):
    legs = (Leg(0, 0.0, 0.02, 0), Leg(1, 0.02, 0.04, 1))
    cases = [tmp_path / leg.name for leg in legs]
    for case in cases:
        case.mkdir()
    (cases[1] / SWITCH).write_text(json.dumps({"carried_at": 0.012, "carried_jump_fraction": 0.0}))
    force = [table(1, 20, np.cos, np.sin), table(13, 40, np.cos, np.sin)]
    energy = [table(1, 20, lambda t: 2 + t)[1::2], table(13, 40, lambda t: 1.01 * (2 + t))[1::2]]
    (found,) = switches(legs, cases, force, energy)
    assert found["time"] == 0.02
    assert found["jump_fraction"] == pytest.approx(0.01)
    assert found["kinetic_energy_before"] == pytest.approx(2.02)
    assert found["force_settled_after"] == 0.0
    assert switches(legs[:1], cases[:1], force[:1], energy[:1]) == []


def test_a_leg_is_run_in_for_some_steps_and_some_time():
    assert [run_in_steps(step) for step in (1e-3, 5e-4, 2.5e-4)] == [8, 8, 16]
    assert Leg(1, 0.1, 0.2, 0).begin(2.5e-4) == pytest.approx(0.096)
    assert Leg(0, 0.0, 0.2, 0).begin(2.5e-4) == 0.0
