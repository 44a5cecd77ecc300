"""The time of a run on n ranks: the measurements that it is made of, and its limits."""

import re

import pytest

from docs.evidence.ranks import prediction, step_time, useful_ranks
from pipeline.openfoam.case_folder import LEAST_CELLS
from pipeline.runs.estimate import duration
from tests.conftest import write_scene


@pytest.mark.parametrize("ranks, measured", [(1, 0.2269), (2, 0.1269)])
def test_the_measured_steps_are_returned(ranks, measured):
    """Rounded constants: 0.1 %."""
    assert step_time(74305, ranks, 4243) == pytest.approx(measured, rel=1e-3)


@pytest.mark.parametrize("cells, steps, taken", [(3054, 420, 8.8), (2308, 640, 11.9)])
def test_small_runs_cost_more_than_their_cells(cells, steps, taken):
    """Wall time of single_finger (half its time step) and pinch at smoke on a quiet machine."""
    assert steps * step_time(cells, 1, cells) == pytest.approx(taken, rel=0.2)


def test_larger_meshes_pay_for_more_ranks():
    small, large = (useful_ranks(n, n / 12) for n in (3e4, 3e6))
    assert small < large
    assert large * LEAST_CELLS <= 3e6  # no rank has too little to do


def test_the_serial_part_bounds_the_speed_up():
    """9.3 of 2,900 ns a cell are one rank's alone: Amdahl's bound."""
    one, many = (step_time(1e8, n, 1e7) for n in (1, 4096))
    assert 30 < one / many < 2.9e-6 / 9.3e-9


def test_a_prediction_says_what_it_does_not_know(tmp_path):
    """The memory of a full node is assumed: the answer is a range, with its source."""
    text = prediction(write_scene(tmp_path / "small"), 40_000_000, 1_500_000)
    answer = next(line for line in text.splitlines() if "no longer pay" in line)
    low, high = re.search(r"\(([\d.]+) min to ([\d.]+) min, by the memory", answer).groups()
    about = re.search(r"about ([\d.]+) min", answer).group(1)
    assert float(low) < float(about) < float(high) < 3.5 * float(low)
    assert "Galeazzo" in text


@pytest.mark.parametrize(
    "seconds, text", [(6.2, "6 s"), (89, "89 s"), (600, "10 min"), (7200, "2.0 h")]
)
def test_times_are_in_the_unit_that_is_read(seconds, text):
    assert duration(seconds) == text
