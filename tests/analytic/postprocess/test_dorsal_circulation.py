"""Circulation of the tip's dorsal side: exact vortices, and a body that turns in water at rest."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from docs.evidence.dorsal_circulation import dorsal_circulation
from piv.vortices.lamb_oseen_fit import lamb_oseen

GAMMA, X0, Y0, WIDTH = -8e-3, 0.011, 0.172, 0.0167
AXIS = np.arange(-0.06, 0.0601, 0.0005)
TIP = np.array([X0 + 0.01, Y0])  # its dorsal side is -x: the vortex is 10 mm off, 2 to 4 core radii
TURN = np.linspace(0.0, 2 * np.pi, 720, endpoint=False)


def found(*vortices, body=(0.05, 0.22), radius=0.004, rate=0.0) -> pd.Series:
    """Circulation at 0.2 s of vortices (x, y, circulation, core radius) and a disc.

    The disc turns by `rate` (rad/s); by default it lies outside the region.
    """
    x, y = AXIS, AXIS + 0.17
    grid = np.meshgrid(x, y)
    still = np.zeros((2, *grid[0].shape))
    velocity = sum((np.array(lamb_oseen(*grid, *vortex)) for vortex in vortices), still)
    wet = np.hypot(grid[0] - body[0], grid[1] - body[1]) > radius
    circle = radius * np.stack([np.cos(TURN), np.sin(TURN)], axis=1)
    of_finger = {
        "tip": TIP, "tip_direction": [0.0, -1.0], "dorsal_direction": [-1.0, 0.0],
        "outline": body + circle, "outline_velocity": rate * circle[:, ::-1] * [-1, 1],
    }  # fmt: skip
    u, v = np.where(wet, velocity, np.nan)
    fields = {"u": u, "v": v, "valid": wet.astype(np.uint8)}
    axes = {1: ("time", "finger", "axis"), 2: ("time", "finger", "point", "axis")}
    variables = {n: (("time", "y", "x"), np.stack([field] * 2)) for n, field in fields.items()}
    variables |= {n: (axes[np.ndim(f)], np.stack([[f]] * 2)) for n, f in of_finger.items()}
    plane = xr.Dataset(variables, {"time": [0.1, 0.2], "y": y, "x": x}, {"tip_width": WIDTH})
    rows = dorsal_circulation(plane, (0.15, 0.3))
    assert rows["time"].tolist() == [0.2]
    return rows.iloc[0]


@pytest.mark.parametrize("core_radius", [0.0025, 0.0045])
def test_circulation_does_not_depend_on_the_core(core_radius):
    row = found((X0, Y0, GAMMA, core_radius))
    # of a core of 4.5 mm 0.1 % lies beyond the plane through the tip, 10 mm off (erfc(10/4.5)/2)
    assert row.circulation == pytest.approx(GAMMA, rel=2e-3)


def test_vortices_on_the_ventral_side_or_far_away_do_not_count():
    others = ((TIP[0] + 0.012, Y0, -GAMMA, 0.002), (X0 - 0.01, Y0 - 0.045, GAMMA, 0.002))
    # the others are 6 core radii outside
    assert found((X0, Y0, GAMMA, 0.003), *others).circulation == pytest.approx(GAMMA, rel=2e-3)


def test_the_wall_layer_counts_although_the_grid_does_not_resolve_it():
    """Around a disc that turns in water at rest: minus the circulation of its surface."""
    rate, radius, centre = 20.0, 0.006, (X0, Y0 + 0.003)
    row = found(body=centre, radius=radius, rate=rate)
    # a polygon of 720 points in place of the circle: 1e-5
    assert row.circulation == pytest.approx(-2 * np.pi * radius**2 * rate, rel=1e-4)
