"""What follows one vortex of a pinch refuses a core that its mirror image overlaps."""

import numpy as np
import pandas as pd
import pytest

from postprocess.compare.pinch_quantities import PINCH_QUANTITIES
from postprocess.evidence.evidence import Evidence, Part
from postprocess.evidence.time_windows import Clock

WINDOW = (0.2, 0.3)
CORE = 0.004  # m


def descent(x):
    """Of a vortex that sinks by 6 mm in the window, at x (m) from the plane between the fingers in the end."""
    time = np.linspace(*WINDOW, 11)
    fixed = {"track": 0, "finger": 0, "tip_distance": 0.01, "circulation": -1e-2, "core_radius": CORE}
    table = pd.DataFrame(
        {"time": time, "x": np.linspace(-0.02, x, 11), "y": 0.2 - 0.06 * (time - 0.2)} | fixed
    )
    evidence = Evidence({}, {"cfd": table}, 0.3, Clock(time, time))
    return PINCH_QUANTITIES["vortex_descent"].measure(Part(evidence, "cfd", WINDOW))


def test_a_core_clear_of_the_plane_is_followed():
    assert descent(-1.01 * CORE) == pytest.approx(0.006)


def test_a_core_that_its_mirror_image_overlaps_is_not():
    with pytest.raises(
        ValueError, match=r"at 0.300 s the core of finger 0's vortex overlaps its mirror image"
    ):
        descent(-0.99 * CORE)
