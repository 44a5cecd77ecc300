"""What a flow with a known acceleration does to a small sphere on the line between two fingers."""

import numpy as np
import pytest

from docs.evidence.pinch import G, acceleration, carried, held_excess

TIME, Y = np.linspace(0, 0.4, 201), np.linspace(-0.02, 0.06, 321)


def test_stagnation_flow_that_grows():
    rate = 3 * TIME[:, None]  # 1/s: v = rate y, so Dv/Dt = (rate' + rate²) y
    known = (3 + rate**2) * Y
    assert acceleration(TIME, Y, rate * Y) == pytest.approx(known, abs=1e-4)
    start = np.array([0.001, 0.01])
    end = carried(TIME, Y, rate * Y, start)
    assert end == pytest.approx(start * np.exp(1.5 * 0.4**2), rel=1e-5)


def test_lamb_oseen_pair_that_climbs():
    circulation, core, apart = 5e-3, 0.006, 0.012  # m²/s, m, m from the line
    climb = circulation / (4 * np.pi * apart)

    def swirl(time):
        square = apart**2 + (Y - climb * time) ** 2
        return circulation * apart / (np.pi * square) * -np.expm1(-square / core**2)

    v = np.array([swirl(t) for t in TIME])
    # a steady pattern that moves with the pair: Dv/Dt = (v - climb) ∂v/∂y
    square = apart**2 + (Y - climb * TIME[:, None]) ** 2
    decay = np.exp(-square / core**2)
    slope = 2 * (Y - climb * TIME[:, None]) * circulation * apart / np.pi
    slope = slope * (decay / core**2 / square - (1 - decay) / square**2)
    inside = slice(2, -2)
    got = acceleration(TIME, Y, v)[inside, inside]
    assert got == pytest.approx(((v - climb) * slope)[inside, inside], abs=2e-3 * np.ptp(got))


def test_sphere_held_in_water_carries_its_inertia_and_stokes_drag():
    assert held_excess(np.zeros(1), np.ones(1), 0.005, 1e-6) == pytest.approx(1.5 / G)
    # Stokes: 6 π μ a v over ρ V g
    slow = held_excess(np.array([1e-6]), np.zeros(1), 0.001, 1e-6)
    assert slow == pytest.approx(18 * 1e-6 * 1e-6 / 0.001**2 / G, rel=0.01)
    # at Re 1000 the drag coefficient is 0.44: ρ/2 C A v² over ρ V g
    fast = held_excess(np.array([0.2]), np.zeros(1), 0.005, 1e-6)
    assert fast == pytest.approx(0.75 * 0.44 * 0.2**2 / 0.005 / G, rel=0.02)
