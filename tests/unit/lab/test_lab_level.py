"""The level's own numerical error, by windows of the stroke."""

import numpy as np
import pandas as pd
import pytest

from postprocess.lab.inputs import LOST, MEASURED, UNIFORM, level_uncertainty, level_windows

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


def test_levels_are_named_from_the_coarsest_on(tmp_path):
    """So that the first one that decides is the cheapest; about_tip is no level."""
    windows = level_windows([scene(tmp_path)], "draft", False)
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
