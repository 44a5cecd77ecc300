"""The water's moment on the finger as a quantity of the comparison."""

import numpy as np
import pandas as pd
import pytest

from piv.formats.plane_series import AXES
from piv.vortices.find import VortexSettings
from postprocess.lab.flow import QUANTITIES, flow_quantities, tables
from postprocess.lab.load import with_load
from postprocess.lab.motion import Case
from postprocess.lab.pose import Pose, camera_series
from postprocess.lab.register import Law, Registration
from postprocess.lab.virtual_experiment import Sides
from tests.lab_scene import finger_kinematics, vortex_series

FLUID = 998.0, 1e-6


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    kinematics = finger_kinematics(tmp_path_factory.mktemp("load"))
    pose = Pose(0.25, 0.02, kinematics.root, (220.0, 430.0))
    law = Law(np.array([1.0, 0.0, 1.0]), np.diag([1e-3, 2e-4, 1e-3]) ** 2, 0.0)
    none, covariance = np.empty(0), np.diag([0.1, 0.1, 1e-3, 1e-3]) ** 2
    registration = Registration(pose, covariance, 0.0, law, none, none, none, None)
    return Case(kinematics, registration, 0.0)


def sides(case, rate):
    """Equal flows of recording and simulation at a rate (Hz); a sheet of no pressure."""
    times, pose = 0.10 + np.arange(9) / rate, case.registration.pose
    x, y = np.arange(0.0, 0.15, 2e-3), np.arange(0.0, 0.128, 2e-3)
    flow = vortex_series(case.kinematics, times, spacing=2e-3)
    seen = camera_series(flow, pose, x, y, times)
    std = np.full(seen["u"].shape, 2e-3, np.float32)
    seen = seen.assign({n: (AXES[n], std) for n in ("u_std", "v_std")})
    sheet = flow.assign(p=0 * flow["u"])
    return Sides(seen, seen, seen, VortexSettings(scale=4e-3), 0.006), sheet


def test_a_rate_that_gives_no_pressure_is_named(case):
    slow, sheet = sides(case, 50.0)
    made = with_load(slow, case, sheet, *FLUID)
    assert made.load == {}
    assert made.no_load.startswith("The moment of the water is not compared: between two fields")


def test_equal_flows_have_equal_moments(case):
    same, sheet = sides(case, 250.0)
    equal = with_load(same, case, sheet, *FLUID).load
    pd.testing.assert_frame_equal(equal["data"], equal["virtual"])
    np.testing.assert_allclose(equal["direct"]["load"], 0.0, atol=1e-12)  # of a sheet with p = 0
    # the density is a factor of both
    heavy = with_load(same, case, sheet, 2 * FLUID[0], FLUID[1]).load["data"]
    np.testing.assert_allclose(heavy, 2 * equal["data"], rtol=1e-5)


def test_it_is_a_row_where_three_instants_know_it(case):
    flow, sheet = sides(case, 250.0)
    loaded = with_load(flow, case, sheet, *FLUID)
    for side, names in ((flow, ["circulation", "centre"]), (loaded, [*QUANTITIES])):
        rows = flow_quantities(case, side, tables(case, side))
        assert [row.name for row in rows] == names
    assert rows[-1].error == pytest.approx(0.0, abs=1e-12)
