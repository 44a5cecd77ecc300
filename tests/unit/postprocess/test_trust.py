"""What the head of a page says of the level and of the finger's work."""

import re

import pandas as pd
import pytest

from postprocess.report.trust import level_error
from postprocess.report.wording import power_sentence
from tests.conftest import CASES, ROOT

TABLE = """# {"format": "tradeoff"}
run,start_s,end_s,reference,error_circulation,error_centre,error_near_tip,error_force,error
fine,0.1,0.2,,0.03,0.06,0.05,0.04,0.06
fine,0.2,0.4,,0.05,0.07,0.09,0.04,0.09
smoke,0.1,0.2,fine,0.88,0.2,0.7,1.718,1.718
draft,0.1,0.2,fine,0.142,0.1,0.12,0.08,0.142
draft,0.2,0.3,fine,0.2,0.1,0.25,0.08,0.25
draft,0.3,0.4,fine,,,0.4,0.1,
coarse,0.1,0.2,fine,0.1,0.1,0.1,0.08,0.1
"""


@pytest.fixture
def scene(tmp_path):
    folder = tmp_path / "finger"
    (folder / "studies" / "results").mkdir(parents=True)
    (folder / "studies" / "results" / "errors.csv").write_text(TABLE)
    return folder


def plain(text):
    return text.replace("\u00a0", " ")


@pytest.mark.parametrize(
    "level, part",
    [
        ("draft", "Level draft errs by at most 14.2 % until 0.200 s, 25.0 % until 0.300 s"),
        ("draft", "against level fine, the finest whole stroke that was run,"),
        ("draft", "whose own error is estimated at 9.0 % at most"),
        ("fine", "extrapolated from the levels below"),
    ],
)
def test_a_level_errs_as_the_trade_off_measured(scene, level, part):
    error = level_error([scene], level)
    assert part in plain(error.sentence)
    assert error.trial == ""


def test_the_page_has_every_error_with_its_window(scene):
    names, rows = level_error([scene], "draft").table
    assert names[2] == "velocity within two tip widths of the tip"
    assert [window for window, _ in rows] == ["0.100 to 0.200", "0.200 to 0.300", "0.300 to 0.400"]
    assert [plain(value) for value in rows[2][1]] == ["–", "–", "40.0 %", "10.0 %"]


def test_numbers_end_where_a_vortex_is_lost_an_error_is_large_or_nothing_was_measured(scene):
    assert level_error([scene], "draft").end == 0.3
    assert level_error([scene], "coarse").end == 0.2
    path = scene / "studies" / "results" / "errors.csv"
    path.write_text(TABLE.replace("0.08,0.25", "0.26,0.26"))
    assert level_error([scene], "draft").end == 0.2


def test_another_scene_has_the_windows_at_the_pace_of_its_own_stroke(scene, tmp_path):
    error = level_error([tmp_path / "child", scene], "draft", (0.2, 0.4))
    assert error.end == pytest.approx(0.6)
    assert error.table[1][0][0] == "0.200 to 0.400"
    assert "was not measured for this scene" in error.sentence


def test_windows_end_with_the_run(scene, tmp_path):
    """An own finger's stroke was called wrong at instants after its run."""
    error = level_error([tmp_path / "child", scene], "draft", (0.2, 0.4), 0.5)
    assert [window for window, _ in error.table[1]] == ["0.200 to 0.400", "0.400 to 0.500"]
    assert "0.600" not in error.sentence
    early = level_error([scene], "smoke", None, 0.05)
    assert early.trial.endswith("wrong by up to 172\u00a0%")
    assert early.table[1][0][0] == "0.100 to 0.200"


def test_smoke_is_a_trial_also_of_a_scene_that_extends_the_measured_one(scene, tmp_path):
    error = level_error([tmp_path / "child", scene], "smoke")
    assert error.sentence.endswith(", on scene finger.")
    assert error.trial.endswith("wrong by up to 172\u00a0% on scene finger")


def test_an_error_that_was_not_measured_is_said(scene):
    error = level_error([scene], "medium")
    words = f"was not measured for this scene (softfinger tradeoff {scene} measures it"
    assert words in error.sentence
    assert (error.trial, error.table, error.end) == ("", None, None)


def test_the_power_balance_in_short():
    taken = {"viscous": 0.1, "convection": 0.2, "coupling": 0.1}
    balance = {"work": -1.0, "taken": taken, "unexplained_fraction": -0.006}
    sentence = power_sentence(balance)
    assert "water the numerical schemes take 30\u00a0%" in sentence
    assert "0.6\u00a0% is unexplained" in sentence


def measured(name: str) -> pd.DataFrame:
    results = CASES / "single_finger" / "studies" / "results" / f"{name}.csv"
    return pd.read_csv(results, comment="#").set_index("run")


def test_the_readme_quotes_the_measured_errors():
    errors = measured("errors").loc["coarse"]
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    part = readme.partition("**Level coarse**")[2].partition("Level smoke")[0]
    percent = [100 * errors[f"error_{name}"] for name in ("near_tip", "circulation", "force")]
    wanted = [errors["end_s"], percent[0], percent[1], errors["error_centre_mm"], percent[2]]
    lists = re.findall(r"((?:[\d.]+, )+[\d.]+\s+and\s+[\d.]+)", part)
    quoted = [re.findall(r"[\d.]+", text) for text in lists]
    assert len(quoted) == 5
    for values, shown in zip(wanted, quoted, strict=True):
        assert [rounded(v, text) for v, text in zip(values, shown, strict=True)] == shown


def rounded(value: float, like: str) -> str:
    """A value with as many decimals as a text."""
    return f"{value:.{len(like.partition('.')[2])}f}"


def test_the_page_of_costs_quotes_the_measured_errors_and_costs():
    page = (ROOT / "docs" / "tradeoff.md").read_text(encoding="utf-8")
    parts = ("near_tip", "circulation", "centre_mm", "velocity", "force")
    tables = {
        6: ("errors", ["end_s", *(f"error_{part}" for part in parts)]),
        2: ("tradeoff", ["cells", "cpu_flow_s"]),
    }
    seen = dict.fromkeys(tables, 0)
    for level, cells in re.findall(r"(?m)^\| (draft|coarse|medium) \| (.*) \|$", page):
        shown = cells.replace(",", "").split(" | ")
        name, columns = tables[len(shown)]
        rows = measured(name).loc[[level], columns].to_numpy(float)
        factors = [
            100 if column.startswith("error_") and not column.endswith("_mm") else 1
            for column in columns
        ]
        texts = [[rounded(v, s) for v, s in zip(row * factors, shown, strict=True)] for row in rows]
        assert shown in texts, level
        seen[len(shown)] += 1
    levels = set(measured("errors").index) & {"draft", "coarse", "medium"}
    assert seen == {6: 4 * len(levels), 2: len(levels)}
