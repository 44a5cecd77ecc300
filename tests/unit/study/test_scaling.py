"""The scaling model: exact limits, and a fit that recovers its own measurements."""

from __future__ import annotations

import re

import pytest

from pipeline.runs.estimate import duration
from pipeline.study import predict
from pipeline.study.scaling_data import read_data
from pipeline.study.scaling_model import Network, Solver, fit, imbalance, step_time, useful_ranks
from tests.conftest import write_scene

NETWORK = Network(latency=2e-6, bandwidth=1e9, ranks_per_node=64, saturated=2.0)
SOLVER = Solver(4e-6, pair_slowdown=1.1, serial_seconds_per_cell=0.0, pressure_cycles=6.0)
FREE = Network(latency=0.0, bandwidth=1e30, ranks_per_node=10**6, saturated=1.0)


def test_one_rank_costs_its_cells():
    assert step_time(1e5, 1, 5e3, SOLVER, NETWORK) == pytest.approx(0.4)


def test_without_communication_only_imbalance_is_lost():
    solver = Solver(4e-6, 1.0, 0.0, 6.0)
    for ranks in (2, 16, 64):
        ideal = 4e-6 * 1e6 / ranks * imbalance(1e6, ranks, 5e4)
        assert step_time(1e6, ranks, 5e4, solver, FREE) == pytest.approx(ideal)


def test_fit_recovers_the_solver_that_made_the_measurements():
    step = step_time(6e4, 1, 4.9e3, SOLVER, NETWORK)
    one = {"cells": 6e4, "columns": 4.9e3, "step_s": step, "cycles": 6.0}
    two = one | {"alone_s": one["step_s"], "step_s": step_time(6e4, 2, 4.9e3, SOLVER, NETWORK)}
    solver = fit(one, two, NETWORK)
    assert solver.seconds_per_cell == pytest.approx(4e-6)
    assert solver.pair_slowdown == pytest.approx(1.1, rel=1e-6)


def test_larger_meshes_and_faster_networks_pay_for_more_ranks():
    small, large = (useful_ranks(n, n / 12, SOLVER, NETWORK) for n in (3e4, 3e6))
    slow = useful_ranks(3e6, 2.5e5, SOLVER, Network(5e-5, 1e8, 64, 2.0))
    assert small < large
    assert slow < large
    assert large * 5000 <= 3e6  # no rank has too little to do


def test_a_serial_part_bounds_the_speed_up():
    solver = Solver(4e-6, 1.0, 4e-8, 6.0)  # a hundredth: Amdahl's bound is 101
    assert step_time(1e6, 1, 1e5, solver, FREE) / step_time(1e6, 4096, 1e5, solver, FREE) < 101


def test_the_shipped_measurements_are_sound():
    one, two, network = read_data()
    solver = fit(one, two, network)
    assert step_time(one["cells"], 1, one["columns"], solver, network) == pytest.approx(0.2269)
    assert step_time(two["cells"], 2, two["columns"], solver, network) == pytest.approx(
        0.1269, rel=0.02
    )
    # 1 to 20 µs a cell and step, two or four pressure solves: any machine of these years
    assert 1e-6 < solver.seconds_per_cell < 2e-5
    assert 1.0 <= solver.pair_slowdown < 2.0
    assert 1 < useful_ranks(6e5, 3e4, solver, network) <= 4096


def test_a_prediction_says_what_it_does_not_know(tmp_path, monkeypatch):
    """The memory of a full node is assumed: the answer is a range, with its source."""
    monkeypatch.setattr(predict, "size", lambda scene: (40_000_000, 1_500_000))
    text = predict.report(write_scene(tmp_path / "small"))
    answer = next(line for line in text.splitlines() if "no longer pay" in line)
    low, high = re.search(r"\(([\d.]+) min to ([\d.]+) min, by the memory", answer).groups()
    about = re.search(r"about ([\d.]+) min", answer).group(1)
    assert float(low) < float(about) < float(high) < 3.5 * float(low)
    assert "Galeazzo" in text
    assert "InfiniBand" in text


@pytest.mark.parametrize(
    "seconds, text", [(6.2, "6 s"), (89, "89 s"), (600, "10 min"), (7200, "2.0 h")]
)
def test_times_are_in_the_unit_that_is_read(seconds, text):
    assert duration(seconds) == text


@pytest.mark.parametrize("cells, steps, taken", [(3054, 420, 8.8), (2308, 640, 11.9)])
def test_small_runs_cost_more_than_their_cells(cells, steps, taken):
    """Wall time of single_finger (half its time step) and pinch at smoke on a quiet machine."""
    one, two, network = read_data()
    step = step_time(cells, 1, cells, fit(one, two, network), network)
    assert steps * step == pytest.approx(taken, rel=0.2)
