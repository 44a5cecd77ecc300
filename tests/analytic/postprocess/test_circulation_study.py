"""Ways to count the circulation of a tip, on Lamb-Oseen vortices and on a body that turns in still water."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from piv.vortices.lamb_oseen_fit import lamb_oseen
from postprocess.evidence.dorsal_circulation import dorsal_circulation
from tests.studies import circulation
from tests.studies.circulation import REGIONS, beyond_margin

GAMMA, X0, Y0, WIDTH = -8e-3, 0.011, 0.172, 0.0167
AXIS = np.arange(-0.06, 0.0601, 0.0005)
TIP = np.array([X0 + 0.01, Y0])  # its dorsal side is -x: the vortex is 10 mm off, 2 to 4 core radii
REACH = 1.5  # tip widths: 25 mm, 15 mm and more from the vortex
TURN = np.linspace(0.0, 2 * np.pi, 720, endpoint=False)
WAYS = {
    "beyond": lambda plane: beyond_margin(plane, (0.15, 0.3), [(REACH, 0.125)])[0],
    "all": lambda plane: dorsal_circulation(plane, (0.15, 0.3), REACH),
}


def plane_of(
    *vortices: tuple[float, float, float, float], body=(0.05, 0.22), radius=0.004, rate=0.0
) -> xr.Dataset:
    """Two instants of vortices (x, y, circulation, core radius) and a disc that turns by `rate` (rad/s), far off unless said."""
    x, y = AXIS, AXIS + 0.17
    grid = np.meshgrid(x, y)
    velocity = sum(
        (np.array(lamb_oseen(*grid, *vortex)) for vortex in vortices), np.zeros((2, *grid[0].shape))
    )
    wet = np.hypot(grid[0] - body[0], grid[1] - body[1]) > radius
    round_it = radius * np.stack([np.cos(TURN), np.sin(TURN)], axis=1)
    of_finger = {
        "tip": TIP, "tip_direction": [0.0, -1.0], "dorsal_direction": [-1.0, 0.0],
        "outline": body + round_it, "outline_velocity": rate * round_it[:, ::-1] * [-1, 1],
    }  # fmt: skip
    fields = {
        "u": np.where(wet, velocity[0], np.nan),
        "v": np.where(wet, velocity[1], np.nan),
        "valid": wet.astype(np.uint8),
    }
    axes = {1: ("time", "finger", "axis"), 2: ("time", "finger", "point", "axis")}
    return xr.Dataset(
        {name: (("time", "y", "x"), np.stack([field] * 2)) for name, field in fields.items()}
        | {
            name: (axes[np.ndim(value)], np.stack([[value]] * 2))
            for name, value in of_finger.items()
        },
        {"time": [0.1, 0.2], "y": y, "x": x},
        {"tip_width": WIDTH},
    )


def only(way: str, plane: xr.Dataset) -> pd.Series:
    rows = WAYS[way](plane)
    assert rows["time"].tolist() == [0.2]
    return rows.iloc[0]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("core_radius", [0.0025, 0.0045])
def test_circulation_and_centre_do_not_depend_on_the_core(way, core_radius):
    found = only(way, plane_of((X0, Y0, GAMMA, core_radius)))
    # of a core of 4.5 mm 0.1 % lies beyond the plane through the tip, 10 mm off (erfc(10/4.5)/2)
    assert found.circulation == pytest.approx(GAMMA, rel=2e-3)
    # points of 0.5 mm: a thousandth of the region's 25 mm
    np.testing.assert_allclose([found.x, found.y], [X0, Y0], atol=2.5e-5)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("moved", [(1e-3, 0.0), (-2.3e-3, 1.1e-3), (0.0, -6e-3)])
def test_a_vortex_that_is_moved_moves_the_centroid_by_as_much(way, moved):
    before, after = (
        only(way, plane_of((X0 + part * moved[0], Y0 + part * moved[1], GAMMA, 0.003)))
        for part in (0, 1)
    )
    # a thousandth of the region again; of a core of 3 mm, 9 mm from the region's edge, 1e-5 is cut off
    np.testing.assert_allclose([after.x - before.x, after.y - before.y], moved, atol=2.5e-5)
    assert after.circulation == pytest.approx(before.circulation, rel=5e-4)


@pytest.mark.parametrize("way", WAYS)
def test_what_is_on_the_ventral_side_or_far_is_not_counted(way):
    others = ((TIP[0] + 0.012, Y0, -GAMMA, 0.002), (X0 - 0.01, Y0 - 0.045, GAMMA, 0.002))
    found = only(way, plane_of((X0, Y0, GAMMA, 0.003), *others))
    # the others are 6 core radii outside
    assert found.circulation == pytest.approx(GAMMA, rel=2e-3)


def test_all_water_has_the_layer_of_a_wall_that_no_point_of_the_grid_resolves():
    """Round a disc that turns in still water lies a layer of no thickness: minus the circulation of its surface."""
    rate, radius, centre = 20.0, 0.006, (X0, Y0 + 0.003)
    found = only("all", plane_of(body=centre, radius=radius, rate=rate))
    # a polygon of 720 points in place of the circle: 1e-5
    assert found.circulation == pytest.approx(-2 * np.pi * radius**2 * rate, rel=1e-4)
    np.testing.assert_allclose([found.x, found.y], centre, atol=1e-7)


def test_the_regions_are_all_counted_from_one_vorticity_of_each_instant(monkeypatch):
    plane = plane_of((X0, Y0, GAMMA, 0.0045), body=(X0, Y0 - 0.012))
    alone = [beyond_margin(plane, (0.0, 0.3), [region])[0] for region in REGIONS]
    taken = []
    gradients = circulation.gradients
    monkeypatch.setattr(circulation, "gradients", lambda *a: taken.append(1) or gradients(*a))
    for one, together in zip(alone, beyond_margin(plane, (0.0, 0.3), REGIONS), strict=True):
        pd.testing.assert_frame_equal(one, together)
    assert len(taken) == plane.sizes["time"]
    assert len(set(REGIONS)) == len(REGIONS)
