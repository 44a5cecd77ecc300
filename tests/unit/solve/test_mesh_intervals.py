"""Dividing a motion among planforms: intervals cover the time, with as few planforms as needed."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.mesh_intervals import read_intervals
from pipeline.kinematics import stage as kinematics
from pipeline.mesh import stage as mesh
from pipeline.mesh.intervals import HYSTERESIS, PADDING, cumulative_deformation, divide, last_move
from pipeline.scene.scene import load_scene
from piv.files.errors import StageError
from tests.conftest import write_scene


def test_deformation_counts_bends_and_factors_of_the_gap_in_both_directions():
    gap = np.array([9e-3, 3e-3, 1e-3, 3e-3])
    assert cumulative_deformation(np.zeros(4), gap) == pytest.approx([0, 1, 2, 3])
    bend = np.radians([0, 55, 110, 55])
    assert cumulative_deformation(bend, np.full(4, np.inf)) == pytest.approx([0, 0.5, 1, 1.5])
    assert cumulative_deformation(bend[:2], gap[:2])[-1] == pytest.approx(np.hypot(1, 0.5))


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(0, 10), min_size=2, max_size=8),
    st.integers(1, 6),
    st.sampled_from([1, 2, 4, 5]),
    st.integers(3, 60),
    st.sampled_from([4, 8]),
)
def test_intervals_cover_the_time_exactly_and_shapes_cover_the_intervals(
    knots, count, sampling, stride, overlap
):
    length = stride * sampling
    steps = np.arange(length * (len(knots) - 1) + 1)
    deformation = np.interp(steps, length * np.arange(len(knots)), knots)
    parts = divide(deformation, count, sampling, overlap)
    assert 1 <= len(parts) <= count
    intervals = sorted(interval for part in parts for interval in part.intervals)
    assert intervals[0][0] == 0
    assert intervals[-1][1] == len(deformation) - 1
    assert all(a[1] == b[0] for a, b in pairwise(intervals))
    if len(intervals) > 1:
        assert min(b - a for a, b in intervals) > 2 * overlap
    assert all(first % sampling == 0 for first, _ in intervals)
    for part in parts:
        for first, end in part.intervals:
            used = deformation[max(0, first - overlap) : end + PADDING + 1]
            assert part.low <= used.min()
            assert used.max() <= part.high


def test_a_long_rest_at_the_end_is_an_interval_of_its_own_and_a_short_one_is_not():
    moving, overlap = 200, 8
    for rest, count in ((15, 1), (300, 2)):
        deformation = np.interp(np.arange(moving + rest + 1), [0, moving], [0.0, 1.0])
        (part,) = divide(deformation, 1, 4, overlap)
        assert len(part.intervals) == count
        if count == 2:
            begin = part.intervals[1][0] - overlap  # its solver starts beside the moving interval's
            assert last_move(deformation) == moving < begin < moving + 8
    assert last_move(np.zeros(50)) == 0


def test_there_and_back_takes_the_first_planform_again_once():
    deformation = np.interp(np.arange(801), [0, 400, 800], [0.0, 1.0, 0.0])
    parts = divide(deformation, 2, 4, 8)
    assert [len(part.intervals) for part in parts] == [2, 1]
    (_, there), (back, _) = parts[0].intervals
    assert there == 200  # at the middle of the deformation
    # and after turning back by the hysteresis
    assert deformation[back] == pytest.approx(0.5 - 0.5 * HYSTERESIS, abs=4 / 400)


def test_a_motion_that_oscillates_at_a_boundary_has_few_intervals():
    step = np.arange(1001)
    deformation = step / 1000 + 0.02 * np.sin(step / 3)  # swings by 4 % of its range 300 times
    parts = divide(deformation, 2, 4, 8)
    assert [len(part.intervals) for part in parts] == [1, 1]


def test_one_planform_suffices_for_the_single_finger_and_a_long_stroke_takes_several(tmp_path):
    scene = write_scene(tmp_path / "single", "2d")
    cycle = (
        "[motion]\nend_time = 0.5\nmax_bend_step_deg = 12.0\n"
        "strokes = [{ pressure_kpa = 39.0, start = 0.005, duration = 0.15 },"
        " { pressure_kpa = -39.0, start = 0.2, duration = 0.25 }]\n"
    )
    far = write_scene(tmp_path / "far", "2d", cycle)
    for each in (scene, far):
        kinematics.run(each, quiet=True)
        mesh.run(each, quiet=True)
    (single,) = read_intervals(scene.out)
    assert (single.start, single.end, single.mesh) == (0.0, 0.42, 0)
    intervals = read_intervals(far.out)
    # it comes back to planforms it had left
    assert 1 < len({interval.mesh for interval in intervals}) < len(intervals)
    worst = np.loadtxt(far.out / "mesh_quality.csv", delimiter=",", skiprows=1)
    assert worst[:, 5].max() <= far.mesh.max_non_orthogonality_deg
    assert worst[:, 2].sum() == pytest.approx(1.0, abs=1e-4)  # shares of the time, rounded
    assert {int(interval) for interval in worst[:, 0]} == {interval.index for interval in intervals}


NEAR_THE_BOTTOM = "[finger]\nroot = [0.0, 0.075]\n[camera]\ncentre = [0.02, 0.06]\n"


def test_a_finger_near_the_bottom_is_told_as_that(tmp_path):
    scene = write_scene(tmp_path / "near", more=NEAR_THE_BOTTOM)
    scene.out.mkdir(parents=True)
    kinematics.run(scene, quiet=True)
    words = r"within 0\.00\d+ m of the bottom, where few cells of mesh\.near_cell"
    with pytest.raises(StageError, match=words):
        mesh.run(scene, quiet=True)


def test_the_shipped_pinch_keeps_its_limits(tmp_path):
    """Level coarse, gap of 0.5 mm: at most 80°, and at most 70° for 95 % of time and stroke."""
    scene = write_scene(tmp_path / "pinch", "quarter", parent="pinch")
    scene = load_scene(scene.folder, "coarse")
    kinematics.run(scene, quiet=True)
    mesh.run(scene, quiet=True)
    table = np.loadtxt(scene.out / "mesh_quality.csv", delimiter=",", skiprows=1)
    share, angle = table[:, 2], table[:, 5]
    assert angle.max() <= 80.0
    assert share[angle <= 70.0].sum() >= 0.95
    # of the shapes, which are equal steps of bend and gap apart
    assert (angle <= 70.0).mean() >= 0.95
    *moving, resting = read_intervals(scene.out)
    # it closes once: no planform is taken twice
    assert [interval.mesh for interval in moving] == list(range(len(moving)))
    assert 2 <= len(moving) <= 3
    assert not resting.moving
    assert resting.mesh == moving[-1].mesh
    assert 0.31 < resting.start < 0.33  # the tips stop at 0.31 s
    shapes = read_kinematics(scene.out / "kinematics.h5").data
    assert float(shapes["shape_gap"].min()) == pytest.approx(0.5e-3, abs=1e-6)


def test_an_interval_overlaps_for_some_steps_and_some_time():
    assert [mesh.overlap_steps(step) for step in (1e-3, 5e-4, 2.5e-4)] == [8, 8, 16]
