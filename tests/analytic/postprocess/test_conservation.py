"""Balances of circulation and impulse between two fingers close for exact flows."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from fileio.formats.plane_series import make_plane
from postprocess.compare.conservation import conservation_numbers
from postprocess.evidence import conservation

DENSITY, VISCOSITY, HEIGHT = 998.2, 1e-6, 0.17


def plane(u, v, p, time):
    """Fields (time, y, x) of functions of (x, y, time) with two upright fingers at rest in them."""
    x, y = np.arange(-0.06, 0.0601, 0.001), np.arange(0.11, 0.2501, 0.001)
    gx, gy = np.meshgrid(x, y)
    box = np.array([[-0.034, 0.245], [-0.034, 0.18], [-0.020, 0.18], [-0.020, 0.245]])
    outline = np.broadcast_to(np.stack([box, box * [-1, 1]]), (time.size, 2, 4, 2))
    inside = (np.abs(np.abs(gx) - 0.027) < 0.007) & (gy > 0.18) & (gy < 0.245)
    fields = (np.stack([np.where(inside, np.nan, f(gx, gy, t)) for t in time]) for f in (u, v, p))
    u, v, p = fields
    return make_plane(x, y, u, v, time=time, p=p, outline=outline, outline_velocity=0 * outline)


def test_head_between_the_sides_of_a_finger_makes_the_circulation_of_a_potential_flow():
    """φ = k(t) ((y − h)² − x²)/2 with Bernoulli's pressure, slipping along a wall."""
    time = np.linspace(0, 0.2, 81)

    def rate(t):
        return 3.0 * np.sin(8.0 * t)

    def u(x, y, t):
        return -rate(t) * x

    def v(x, y, t):
        return rate(t) * (y - HEIGHT)

    def p(x, y, t):
        change = 24.0 * np.cos(8.0 * t) * 0.5 * ((y - HEIGHT) ** 2 - x**2)
        return -DENSITY * (change + 0.5 * (u(x, y, t) ** 2 + v(x, y, t) ** 2))

    series = plane(u, v, p, time)
    table = conservation.half_circulation(series, DENSITY, VISCOSITY)
    x, at = series["x"].values, int(np.argmin(np.abs(series["y"].values - 0.240)))
    ends = conservation.sides(
        series["valid"].values[0, at] != 0, series["outline"].values[0, 0], x, 0.240
    )
    dorsal, ventral = x[list(ends)]
    assert (dorsal, ventral) == pytest.approx(
        (-0.0345, -0.0195), abs=6e-4
    )  # the columns of water beside the finger
    potential = 0.5 * rate(time) * (dorsal**2 - ventral**2)
    assert table["circulation"].to_numpy() == pytest.approx(
        potential, abs=1e-8
    )  # trapezoids of a linear velocity
    explained = table[["walls", "pressure", "carried", "diffused"]].sum(axis=1).to_numpy()
    assert explained == pytest.approx(
        potential, abs=1e-3 * potential.max()
    )  # trapezoids of 2.5 ms in time
    assert table["carried"].abs().max() < 1e-12  # no vorticity to carry


def test_a_steady_shear_carries_as_much_in_as_out():
    """u = S (y - 0.1): equal fluxes of vorticity in and out, and no change."""
    time = np.linspace(0, 0.1, 11)
    series = plane(
        lambda x, y, t: 5.0 * (y - 0.1), lambda x, y, t: 0 * x, lambda x, y, t: 0 * x, time
    )
    table = conservation.half_circulation(series, DENSITY, VISCOSITY)
    explained = table[["walls", "pressure", "carried", "diffused"]].sum(axis=1).to_numpy()
    assert np.ptp(table["circulation"]) < 1e-12
    assert explained == pytest.approx(table["circulation"].to_numpy(), rel=1e-9)


def test_a_turning_wall_sheds_twice_its_area_times_its_turn():
    box = np.array([[0.0, 0.10], [0.02, 0.10], [0.02, 0.16], [0.0, 0.16]])
    centre, turn = box.mean(axis=0), 2.0
    away = box - centre
    velocity = turn * np.stack([-away[:, 1], away[:, 0]], axis=1)
    for outline, speed in (
        (box, velocity),
        (box[::-1], velocity[::-1]),
    ):  # whichever way the outline goes
        assert conservation.wall_part(outline, speed, 1.0) == pytest.approx(-2 * turn * 0.02 * 0.06)


def test_impulse_of_an_exact_pair():
    """±Γ at ∓b: −2bΓ, though the picture ends near it and holds but a part of the momentum."""
    b, y0, circulation, core = 0.010, 0.140, 50e-4, 0.002

    def swirl(x, y, part):
        total = 0.0
        for x0, strength in ((-b, -circulation), (b, circulation)):
            away = (x - x0, y - y0)
            r2 = away[0] ** 2 + away[1] ** 2 + 1e-16
            total = (
                total
                + strength / (2 * np.pi * r2) * -np.expm1(-r2 / core**2) * (-away[1], away[0])[part]
            )
        return total

    time = np.array([0.0])
    series = plane(
        lambda x, y, t: swirl(x, y, 0), lambda x, y, t: swirl(x, y, 1), lambda x, y, t: 0 * x, time
    )
    series = series.assign(  # without the fingers
        valid=xr.ones_like(series["valid"]),
        **{
            name: (series[name].dims, swirl(*np.meshgrid(series["x"], series["y"]), part)[None])
            for part, name in enumerate("uv")
        },
    )
    assert conservation.vertical_impulse(series)[0] == pytest.approx(
        -2 * b * circulation, rel=0.01
    )  # a grid of r_c / 2


@pytest.mark.parametrize("flat, told", [(True, 0.25), (False, None)])
def test_the_impulse_is_compared_in_two_dimensions_only(flat, told):
    """A quarter of the given impulse is missing; of a vortex loop that would say nothing."""
    parts = {
        "walls": [0.0, 1.0],
        "pressure": [0.0, 0.5],
        "carried": [0.0, 0.3],
        "diffused": [0.0, 0.1],
    }
    table = pd.DataFrame(
        {
            "time": [0.0, 0.1],
            "circulation": [0.0, 2.0],
            **parts,
            "impulse": [0.0, -3.0],
            "given": [0.0, -4.0],
        }
    )
    numbers = conservation_numbers(table, None, flat)
    assert numbers["impulse_unexplained"] == told
    assert numbers["circulation_unexplained"] == pytest.approx(0.05)
    assert numbers["circulation_unexplained_after"] is None
