"""reference/inputs.toml, and the level's own numerical error by windows of the stroke."""

import numpy as np
import pandas as pd
import pytest

from pipeline.scene.scene import load_scene
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.lab.inputs import (
    LOST,
    MEASURED,
    UNIFORM,
    Input,
    level_uncertainty,
    level_windows,
    read_inputs,
)
from softfinger.__main__ import main
from tests.lab_scene import CASE


@pytest.fixture
def case(tmp_path):
    """A scene that extends single_finger, and its numbers."""
    (tmp_path / "scene.toml").write_text(f'extends = "{CASE}"\n')
    return tmp_path, scene_numbers(StageFiles(load_scene(tmp_path, "smoke")))


def test_each_run_changes_one_number(case):
    nominal = load_scene(case[0], "smoke")
    changed = {
        of.name: load_scene(case[0], "smoke", of.overrides(case[1]), case[0] / of.name)
        for of in read_inputs(CASE)
    }
    assert changed["pressure"].motion.strokes[0].pressure_kpa == pytest.approx(21.0)
    assert changed["duration"].motion.strokes[0].duration == pytest.approx(0.44)
    for part in ("mesh", "numerics", "finger", "camera"):
        assert all(getattr(one, part) == getattr(nominal, part) for one in changed.values()), part


def test_the_only_stroke_needs_no_run_for_its_duration(case):
    pressure, duration = read_inputs(CASE)
    assert pressure.stretch(case[1]) is None
    assert duration.stretch(case[1]) == pytest.approx(1.1)
    strokes = 2 * case[1]["motion"]["strokes"]
    assert duration.stretch({"motion": {"strokes": strokes}}) is None


def asked(key: str, step: float = 0.001) -> Input:
    """What inputs.toml would say of one number."""
    return Input(name="one", key=key, step=step, limit=1.0, reason="r")


@pytest.mark.parametrize("key, step", [("finger.tip.length", 0.001), ("mesh.tip_cell", 0.0001)])
def test_a_number_of_a_table_or_of_a_level_is_changed(case, key, step):
    """finger.tip.thickness has no value in TOML; mesh.tip_cell is set by the level."""
    value = case[1]
    for name in key.split("."):
        value = value[name]
    assert asked(key, step).overrides(case[1]) == {key: value + step}


@pytest.mark.parametrize(
    "key", ["nothing.at.all", "motion", "motion.strokes.first", "motion.source", "motion.states"]
)
def test_a_key_that_is_no_number_of_the_scene_is_refused(case, key):
    with pytest.raises(ValueError, match="the scene has no number"):
        asked(key).overrides(case[1])


SOUND = 'format = "inputs"\nformat_version = 2\n'
INPUT = "[[input]]\nname = 'a'\nkey = 'b.c'\nstep = 0\nlimit = 1\nreason = 'r'"


@pytest.mark.parametrize(
    "text, message",
    [
        (SOUND.replace('"inputs"', '"x"') + INPUT, "format is 'x', not 'inputs'"),
        (SOUND.replace("2", "1") + INPUT, "format_version of this inputs file is 1"),
        (SOUND, "input: this key is missing"),
        (SOUND + INPUT, r"input\[0\]\.step: .* greater than 0"),
    ],
)
def test_bad_files_are_one_sentence(tmp_path, text, message):
    assert read_inputs(tmp_path) == ()  # without a file
    (tmp_path / "reference").mkdir()
    (tmp_path / "reference" / "inputs.toml").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_inputs(tmp_path)


def test_command_asks_for_dpiv_toml(tmp_path, capsys):
    assert main(["compare", str(CASE), str(tmp_path), "--level", "smoke"]) == 2
    assert "dpiv.toml: missing" in capsys.readouterr().err


TABLE = """# {"format": "errors"}
run,start_s,end_s,error,error_circulation,error_centre
coarse,0.0,0.4,0.03,0.03,0.01
about_tip,0.0,0.4,0.03,0.03,0.01
smoke,0.0,0.4,0.8,0.6,0.8
draft,0.0,0.2,0.06,0.06,0.03
draft,0.2,0.4,,,0.20
"""


def scene(folder):
    """A scene with the results of its trade-off."""
    (folder / "studies" / "results").mkdir(parents=True)
    (folder / "studies" / "results" / "errors.csv").write_text(TABLE)
    return folder


def test_the_largest_error_of_the_windows_that_are_compared_counts(tmp_path):
    windows = level_windows([tmp_path / "own", scene(tmp_path / "parent")], "draft", False)
    early = level_uncertainty(windows, "draft", (0.1, 0.15))
    assert early == pytest.approx({"circulation": 0.06 * UNIFORM, "centre": 0.03 * UNIFORM})
    # a vortex that the level has lost
    late = level_uncertainty(windows, "draft", (0.15, 0.35))
    assert late == pytest.approx({"circulation": LOST * UNIFORM, "centre": 0.20 * UNIFORM})
    assert level_uncertainty(windows, "coarse", (0.41, 0.5))["circulation"] == 0.03 * UNIFORM
    assert level_uncertainty(windows, "fine", (0.1, 0.2)) == {}
    # the first one that decides is the cheapest; about_tip is no level
    assert list(windows["run"].unique()) == ["smoke", "draft", "coarse"]


@pytest.mark.parametrize("level", ["smoke", "draft"])
def test_a_plane_flow_errs_as_the_plane_level_does(tmp_path, level):
    plane = level_uncertainty(level_windows([scene(tmp_path)], level, True), level, (0.0, 0.1))
    assert plane == pytest.approx({"circulation": 0.6 * UNIFORM, "centre": 0.8 * UNIFORM})


def test_a_plane_flow_without_a_study_errs_as_that_of_single_finger(tmp_path):
    table = pd.read_csv(MEASURED / "studies" / "results" / "errors.csv", comment="#")
    worst = table.loc[table["run"] == "smoke", "error_circulation"].max()
    found = level_uncertainty(level_windows([tmp_path], "smoke", True), "smoke", (0.0, 0.42))
    assert found["circulation"] == pytest.approx(worst * UNIFORM)
    known = level_windows([tmp_path], "draft", False)
    assert level_uncertainty(known, "draft", (0.0, np.inf)) == {}
