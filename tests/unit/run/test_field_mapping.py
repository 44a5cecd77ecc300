"""The record of a field mapping between two intervals, from exact tables."""

import json

import numpy as np
import pytest

from pipeline.mesh.stage import overlap_steps
from pipeline.run.map_fields import FIELD_MAPPING, field_mappings, settling_time

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
    # 0.03 is still off, by 2 % of the peak
    assert settling_time(before, after, start, 1.0) == pytest.approx(4 * STEP)
    assert settling_time(before, after, start, 2.0) == pytest.approx(3 * STEP)
    after[7, 1] += 0.1  # the last that both solved
    assert settling_time(before, after, start, 1.0) is None


def test_a_field_mapping_is_recorded_where_both_intervals_were_solved(tmp_path):
    cases, starts = [tmp_path / "interval_0", tmp_path / "interval_1"], [0.0, 0.02]
    for case in cases:
        case.mkdir()
    mapped = {"mapped_at": 0.012, "mapping_jump_fraction": 0.0}
    (cases[1] / FIELD_MAPPING).write_text(json.dumps(mapped))
    force = [table(1, 20, np.cos, np.sin), table(13, 40, np.cos, np.sin)]
    energy = [table(1, 20, lambda t: 2 + t)[1::2], table(13, 40, lambda t: 1.01 * (2 + t))[1::2]]
    (mapping,) = field_mappings(cases, starts, force, energy)
    assert mapping["time"] == 0.02
    assert mapping["jump_fraction"] == pytest.approx(0.01)
    assert mapping["kinetic_energy_before"] == pytest.approx(2.02)
    assert mapping["force_settled_after"] == 0.0
    assert field_mappings(cases[:1], starts[:1], force[:1], energy[:1]) == []


def test_an_interval_overlaps_for_some_steps_and_some_time():
    assert [overlap_steps(step) for step in (1e-3, 5e-4, 2.5e-4)] == [8, 8, 16]
