"""What the head of a page says of the level and of the finger's work."""

import re

import pandas as pd
import pytest

from postprocess.report.trust import level_error
from postprocess.report.wording import power_sentence
from tests.conftest import CASES, ROOT

TABLE = """# {"format": "tradeoff"}
run,level,kind,cells,error,error_circulation,error_centre,error_velocity,error_force,error_dorsal,error_near_tip,reference
fine,fine,flow,600000,0.06,0.03,0.06,0.02,0.04,
smoke,smoke,flow,3000,1.718,0.88,0.2,0.19,1.718,,,medium
draft,draft,flow,30000,0.142,0.142,0.1,0.04,0.08,
dorsal,dorsal,flow,30000,0.142,0.142,0.1,0.04,0.08,0.02,0.3
piv,draft,piv,30000,0.02,0.02,0.01,0.006,,
"""


@pytest.fixture
def scene(tmp_path):
    folder = tmp_path / "finger"
    (folder / "studies" / "results").mkdir(parents=True)
    (folder / "studies" / "results" / "tradeoff.csv").write_text(TABLE)
    return folder


@pytest.mark.parametrize(
    "level, part",
    [
        ("draft", "Level draft errs by 14.2 % at worst (circulation of the tip vortex)"),
        ("draft", "force on the finger 8.0 %"),
        ("draft", "against level fine, the finest that was run,"),
        ("draft", "whose own error is estimated at 6.0 %"),
        ("dorsal", "circulation on the dorsal side of the tip 2.0 %"),
        ("dorsal", "Within two tip widths of the tip its velocity errs by 30"),
        ("fine", "extrapolated from the level below"),
    ],
)
def test_a_level_errs_as_the_trade_off_measured(scene, level, part):
    sentence, trial = level_error([scene], level)
    assert part in sentence.replace("\u00a0", " ")
    assert trial == ""


def test_a_run_of_the_family_of_grids_judges_where_it_is_the_finest(scene):
    path = scene / "studies" / "results" / "tradeoff.csv"
    path.write_text(TABLE + "grid_reference,reference,grid,1700000,0.04,0.04,0.03,0.02,0.02,\n")
    sentence, _ = level_error([scene], "draft")
    assert "against level reference, the finest that was run" in sentence
    assert "estimated at 4.0\u00a0%" in sentence


def test_smoke_is_a_trial_also_of_a_scene_that_extends_the_measured_one(scene, tmp_path):
    sentence, trial = level_error([tmp_path / "child", scene], "smoke")
    assert sentence.endswith(": against level medium, on scene finger.")
    assert trial.endswith("wrong by up to 172\u00a0% on scene finger")


def test_an_error_that_was_not_measured_is_said(scene):
    sentence, trial = level_error([scene], "medium")
    assert f"was not measured for this scene (softfinger tradeoff {scene} measures it" in sentence
    assert trial == ""


def test_the_power_balance_in_short():
    taken = {"viscous": 0.1, "convection": 0.2, "coupling": 0.1}
    balance = {"work": -1.0, "taken": taken, "unexplained_fraction": -0.006}
    sentence = power_sentence(balance)
    assert "water the numerical schemes take 30\u00a0%" in sentence
    assert "0.6\u00a0% is unexplained" in sentence
    assert "until 0.200\u00a0s (before the tips touch) the" in power_sentence(
        balance | {"until": 0.2}
    )


def measured() -> pd.DataFrame:
    results = CASES / "single_finger" / "studies" / "results" / "tradeoff.csv"
    return pd.read_csv(results, comment="#").set_index("run")


def test_the_readme_quotes_the_measured_errors():
    table = measured()
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    part = readme.partition("**Level coarse**")[2].partition("\n- ")[0]
    names = ("circulation", "centre", "velocity", "near_tip", "force")
    quoted = [f"{100 * table.loc['coarse', f'error_{name}']:.1f} %" for name in names]
    assert re.findall(r"[\d.]+ %", part) == quoted


def test_the_page_of_costs_quotes_the_measured_errors():
    table = measured()
    page = (ROOT / "docs" / "tradeoff.md").read_text(encoding="utf-8")
    rows = re.findall(r"(?m)^\| (draft|coarse|medium) \| (.*) \|$", page)
    assert len(rows) == 3
    parts = ("near_tip", "velocity", "circulation", "centre_mm", "peak_vorticity", "force")
    columns = ("cells", "cpu_flow_s", *(f"error_{part}" for part in parts))
    for level, cells in rows:
        for column, shown in zip(columns, cells.replace(",", "").split(" | "), strict=True):
            percent = column.startswith("error_") and not column.endswith("_mm")
            value = table.loc[level, column] * (100 if percent else 1)
            assert f"{value:.{len(shown.partition('.')[2])}f}" == shown, (level, column)
