"""The flow along the trace of the finger."""

import numpy as np
import pytest

from piv.formats.plane_series import make_plane
from piv.images.masks import inside_polygon as inside
from postprocess.evidence.wake_trace import trace_velocity

X, Y = np.arange(0, 0.101, 0.002), np.arange(0, 0.051, 0.002)
TIME = np.linspace(0, 1, 6)


def passing_square(upward):
    """A square of 10 mm moves from x = 10 to 60 mm; v is `upward` in its trace, else −1."""
    left = 0.010 + 0.050 * TIME
    corners = np.array([[0, 0.019], [0.011, 0.019], [0.011, 0.031], [0, 0.031]])
    outline = corners[None, None] + np.stack([left, 0 * left], axis=-1)[:, None, None]
    body = np.stack([inside(o[0], X, Y) for o in outline])
    behind = np.cumsum(body, axis=0) > 0
    v = np.where(behind, upward, -1.0)
    v = np.where(body, np.nan, v)
    return make_plane(X, Y, 0 * v, v, time=TIME, valid=~body, outline=outline)


@pytest.mark.parametrize("upward", [0.3, -0.2])
def test_only_where_the_finger_was_counts(upward):
    mean, share = trace_velocity(passing_square(upward), (0.5, 1.0), 0)
    assert mean == pytest.approx(upward, rel=1e-12)
    assert share == (1.0 if upward > 0 else 0.0)


def test_no_trace_before_the_motion():
    with pytest.raises(ValueError, match="no trace between"):
        trace_velocity(passing_square(0.3), (0.0, 0.1), 0)


def test_inside_a_square():
    mask = inside(np.array([[0.019, 0.019], [0.031, 0.019], [0.031, 0.031], [0.019, 0.031]]), X, Y)
    assert mask.sum() == 6 * 6  # 20, 22 … 30 mm both ways
    assert mask[10, 10]
    assert not mask[8, 10]
