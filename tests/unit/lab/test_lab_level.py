"""The level's own numerical error, by windows of the stroke."""

import numpy as np
import pytest

from postprocess.lab.inputs import LOST, PLANE, UNIFORM, level_uncertainty, level_windows

TABLE = """# {"format": "errors"}
run,start_s,end_s,error,error_circulation,error_centre
draft,0.0,0.2,0.06,0.06,0.03
draft,0.2,0.4,,,0.20
coarse,0.0,0.4,0.03,0.03,0.01
"""


def scene(folder):
    """A scene with the results of its trade-off."""
    (folder / "studies" / "results").mkdir(parents=True)
    (folder / "studies" / "results" / "errors.csv").write_text(TABLE)
    return folder


def test_the_largest_error_of_the_windows_that_are_compared_counts(tmp_path):
    windows = level_windows([tmp_path / "own", scene(tmp_path / "parent")], False)
    early = level_uncertainty(windows, "draft", (0.1, 0.15))
    assert early == pytest.approx({"circulation": 0.06 * UNIFORM, "centre": 0.03 * UNIFORM})
    # a vortex that the level has lost
    late = level_uncertainty(windows, "draft", (0.15, 0.35))
    assert late == pytest.approx({"circulation": LOST * UNIFORM, "centre": 0.20 * UNIFORM})
    assert level_uncertainty(windows, "coarse", (0.41, 0.5))["circulation"] == 0.03 * UNIFORM
    assert level_uncertainty(windows, "fine", (0.1, 0.2)) == {}


def test_a_plane_flow_that_was_not_measured_is_no_better_than_that_of_single_finger(tmp_path):
    windows = level_windows([tmp_path], True)
    assert level_uncertainty(windows, "smoke", (0.0, 0.1)) == PLANE
    assert level_uncertainty(level_windows([tmp_path], False), "draft", (0.0, np.inf)) == {}
