"""The page of where it breaks says of its runs what their table says."""

import pytest

from pipeline.study.rows import read_study
from tests.studies.stability import page

DONE = {"ended": "completed", "from_nothing_fraction": "0.01", "closure_fraction": "0.3"}


def test_every_run_of_the_single_finger_has_its_own_time_step():
    """A level's step may change, and the page's runs with it."""
    assert all(row.overrides.get("numerics.time_step") for row in read_study(page.STUDY))


@pytest.mark.parametrize("step", ["0.001", "0.0005"])
def test_the_base_is_told_as_the_table_has_it(tmp_path, monkeypatch, step):
    stroke = '"[{""pressure_kpa"": 15, ""start"": 0.005, ""duration"": 0.2}]"'
    study = tmp_path / "study.csv"
    study.write_text(
        f"run,level,motion.strokes,numerics.time_step\n{page.BASE},draft,{stroke},{step}\n"
    )
    monkeypatch.setattr(page, "STUDY", study)
    text = "\n".join(page.runs_part([DONE]))
    assert f"level draft, 0 → 15 kPa in 0.2 s, time step {1e3 * float(step):g} ms" in text
