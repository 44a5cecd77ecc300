"""Sides, descent and drift of a pinch's vortices, from integrals over overlapping cores."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from pipeline.scene.scene import load_scene
from postprocess.compare.pinch_quantities import PINCH_QUANTITIES
from postprocess.evidence.evidence import Evidence, Part
from postprocess.evidence.load import single_finger
from postprocess.evidence.pair_integrals import COLUMNS
from postprocess.evidence.time_windows import Clock
from tests.conftest import CASES

WINDOW = (0.2, 0.3)
TIME = np.linspace(*WINDOW, 11)
WIDTH = 0.0167  # m


def vortices(side, flow, circulation, y, kept=slice(None)):
    """One vortex of each finger, 1 mm from the plane, so that the cores of 4 mm overlap."""
    return [
        [time, side, flow, finger, sign * circulation, sign * 0.001, at, 0.004, 0.1]
        for time, at in zip(TIME[kept], np.broadcast_to(y, TIME.shape)[kept], strict=True)
        for finger, sign in ((0, -1), (1, 1))
    ]


def measure(name, rows, finger=0, gap=None):
    """By tips that stand still at 0.18 m and look down with their dorsal side."""
    still = np.broadcast_to([[0.0, 0.18], [0.0, 0.18]], (11, 2, 2))
    down = np.broadcast_to([[0.0, -1.0], [0.0, -1.0]], (11, 2, 2))
    dims = ("time", "finger", "axis")
    plane = xr.Dataset({"tip": (dims, still), "dorsal_direction": (dims, down)}, {"time": TIME})
    planes, clock = {"cfd": plane.assign_attrs(tip_width=WIDTH)}, Clock(TIME, TIME, TIME, gap)
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    evidence = Evidence(planes, {}, 0.3, clock, integrals={"cfd": table})
    return PINCH_QUANTITIES[name].measure(Part(evidence, "cfd", WINDOW, finger))


SINKS = 0.17 - 0.06 * (TIME - 0.2)


@pytest.mark.parametrize("finger", [0, 1])
@pytest.mark.parametrize("name", ["vortex_descent", "dorsal_drift"])
def test_a_pair_whose_cores_overlap_is_followed(name, finger):
    rows = vortices("dorsal", "downward", 1e-2, SINKS) + vortices("ventral", "upward", 3e-2, 0.2)
    assert measure(name, rows, finger) == pytest.approx(0.006)  # the dorsal side looks down


def test_what_jumps_or_is_hardly_there_is_not_followed():
    jumps = np.where(TIME < 0.25, SINKS, SINKS - 1.1 * WIDTH)
    with pytest.raises(ValueError, match="jumps by a tip width"):
        measure("vortex_descent", vortices("dorsal", "downward", 1e-2, jumps))
    with pytest.raises(ValueError, match=r"finger 0 is there for 0.040 s"):
        measure("vortex_descent", vortices("dorsal", "downward", 1e-2, SINKS, slice(5)))
    with pytest.raises(ValueError, match=r"finger 0 is there for 0.000 s"):
        measure("vortex_descent", vortices("ventral", "upward", 1e-2, SINKS))


def test_a_pair_forms_before_contact_or_not_also_where_the_tips_rebound():
    """They meet at 0.23 s, to within a gap of 0.1 mm, and spring back."""
    gap = np.abs(TIME - 0.23) * 0.1
    ventral = vortices("ventral", "upward", 1e-2, 0.2)
    assert measure("ventral_pair_gap", ventral[4:], gap=gap) == pytest.approx(0.001)
    assert measure("ventral_pair_gap", ventral[12:], gap=gap) == 0.0
    with pytest.raises(ValueError, match="is older than the first instant"):
        measure("ventral_pair_gap", ventral, gap=gap)


def test_the_side_is_that_of_the_strongest():
    dorsal = vortices("dorsal", "downward", 2e-2, 0.16)
    ventral = vortices("ventral", "downward", 1e-2, 0.2)
    assert measure("pair_side", dorsal + ventral) == "dorsal"
    stronger_left = [[*row[:4], 3 * row[4], *row[5:]] if row[3] == 0 else row for row in ventral]
    assert measure("pair_side", dorsal + stronger_left) == "different"
    with pytest.raises(ValueError, match="no vortex at both tips"):
        measure("pair_side", [row for row in dorsal if row[3] == 0])


def test_a_coupled_pinch_is_compared_with_a_coupled_single_finger(tmp_path):
    pinch = CASES / "pinch"
    scene = load_scene(pinch, "reference", {"motion.source": "structure"}, tmp_path)
    assert single_finger(scene)[1].endswith("make single_finger LEVEL=reference COUPLED=1")
    scene = load_scene(pinch, "reference")
    assert single_finger(scene)[1].endswith("make single_finger LEVEL=reference")


def test_a_vortex_that_is_not_measured_is_never_the_strongest():
    """Vortices at the edge have no circulation; an instant with no other ended in pandas' error."""
    dorsal = vortices("dorsal", "downward", 2e-2, 0.16)
    hidden = vortices("ventral", "upward", np.nan, 0.2)
    assert measure("pair_side", dorsal[2:] + hidden) == "dorsal"
    for name in ("pair_side", "ventral_pair_flow"):
        with pytest.raises(ValueError, match="circulation of no vortex is measured"):
            measure(name, hidden)
