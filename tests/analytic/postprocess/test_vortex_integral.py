"""Circle integrals give the circulation and centre of a Lamb-Oseen vortex of any core."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from piv.vortices.lamb_oseen_fit import lamb_oseen
from postprocess.evidence.vortex_integral import vortex_integrals

GAMMA, X0, Y0, RADIUS = -8e-3, 0.011, 0.172, 0.0125
AXIS = np.arange(-0.04, 0.0601, 0.0005)


def plane_of(core_radius: float, background: float = 0.0) -> xr.Dataset:
    """Two instants of one vortex; `background` (m/s) is a uniform drift."""
    x, y = AXIS, AXIS + 0.16
    u, v = lamb_oseen(*np.meshgrid(x, y), X0, Y0, GAMMA, core_radius)
    fields = {"u": u + background, "v": v, "valid": np.ones(u.shape, np.uint8)}
    return xr.Dataset(
        {name: (("time", "y", "x"), np.stack([field] * 2)) for name, field in fields.items()},
        {"time": [0.1, 0.2], "y": y, "x": x},
        {"tip_width": 0.0167},
    )


def track(x: float = X0) -> pd.DataFrame:
    return pd.DataFrame(
        {"time": [0.1, 0.2], "x": x, "y": Y0, "circulation": 0.5 * GAMMA, "core_radius": 1.0}
    )


@pytest.mark.parametrize("core_radius", [0.0025, 0.0045])
def test_circulation_is_what_lies_within_the_circle(core_radius):
    integrals = vortex_integrals(plane_of(core_radius, 0.02), track(), RADIUS, (0.0, 0.3))
    inside = GAMMA * (1 - np.exp(-((RADIUS / core_radius) ** 2)))
    # five points of 0.5 mm smooth a core of 2.5 mm; the circle's edge is stepped
    np.testing.assert_allclose(integrals["circulation"], inside, rtol=5e-3)
    np.testing.assert_allclose(integrals[["x", "y"]], [[X0, Y0]] * 2, atol=1e-5)


def test_a_track_that_is_off_the_centre_finds_it():
    integrals = vortex_integrals(plane_of(0.003), track(X0 + 0.002), RADIUS, (0.15, 0.3))
    assert integrals["time"].tolist() == [0.2]
    # of 2 mm, what the circle cuts off on one side is left
    assert integrals["x"][0] == pytest.approx(X0, abs=1e-4)


def test_vorticity_of_the_other_sense_is_not_counted():
    plane = plane_of(0.003)
    u, v = lamb_oseen(*np.meshgrid(plane["x"], plane["y"]), X0 + 0.006, Y0, -GAMMA / 4, 0.001)
    plane["u"], plane["v"] = plane["u"] + u, plane["v"] + v
    integrals = vortex_integrals(plane, track(), RADIUS, (0.0, 0.3))
    # but for what the two senses cancel where they overlap
    assert -integrals["circulation"][0] == pytest.approx(-GAMMA, rel=0.05)


def test_an_instant_with_nothing_in_the_circle_has_no_row():
    plane = plane_of(0.003)
    plane["valid"][0] = 0
    found = vortex_integrals(plane, track(), RADIUS, (0.0, 0.3))
    assert found["time"].tolist() == [0.2]


def test_the_wall_layer_of_a_body_is_left_out():
    plane = plane_of(0.002)
    body = (plane["y"] < Y0 - 0.008) & (plane["x"] < np.inf)
    layer = (plane["y"] < Y0 - 0.0065) & ~body
    plane["u"] = plane["u"].where(~layer, plane["u"] + 0.1 * (Y0 - 0.0065 - plane["y"]) / 0.0015)
    plane["valid"] = plane["valid"].where(~body, 0)
    integrals = vortex_integrals(plane, track(), RADIUS, (0.0, 0.3))
    # of the vortex nothing is left out; five points smear a percent of the layer beyond it
    np.testing.assert_allclose(integrals["circulation"], GAMMA, rtol=1e-2)
