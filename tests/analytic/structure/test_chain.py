"""The elastic chain against beams in closed form: elastica, frequencies, energy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from pipeline.formats.bending_states import read
from pipeline.kinematics.pressure_law import stroke_law
from pipeline.structure.chain import GAP, MIDDLE, RUBBER, Chain, placed
from pipeline.structure.energy import energies, open_share
from pipeline.structure.motion import Surroundings, at_rest, motion
from tests.analytic.structure.beams import beam
from tests.conftest import CASES

STATES = read(CASES / "single_finger" / "kinematics" / "states.h5")
LENGTH, WIDTH, HEIGHT, EI, MASS = 0.07, 0.028, 0.0167, 0.48e-3, 0.31  # MASS in kg/m


def straight(pieces=124, **law):
    return beam(LENGTH, HEIGHT, WIDTH, EI, pieces, **law)


def elastica(alpha):
    """Rotation and place (over the length) of a loaded beam's end; alpha = F L²/EI."""

    def shot(curvature):
        return solve_ivp(
            lambda s, y: [y[1], -alpha * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])],
            (0, 1), [0, curvature, 0, 0], rtol=1e-10, atol=1e-12,
        ).y[:, -1]  # fmt: skip

    return shot(brentq(lambda c: shot(c)[1], 0.3 * alpha, alpha + 1e-9))[[0, 2, 3]]


@pytest.mark.parametrize("alpha", [0.1, 1.0, 3.0])
def test_elastica_with_a_load_at_its_end(alpha):
    """The weight of the last slice alone; 1 %: 31 slices leave 0.1 %, of second order."""
    chain = straight()
    length = LENGTH - 0.5 * chain.lengths[-1]
    weight = np.zeros(chain.slices)
    weight[-1] = alpha * EI / length**2 / 9.81 / chain.lengths[-1]
    loaded = straight(rubber_mass=weight)  # per slice in place of one number
    delta = at_rest(loaded, 0.0, Surroundings(9.81j), np.zeros((chain.slices, 3)))
    turn, along, across = elastica(alpha)
    end = placed(loaded.unloaded(np.zeros(1)), 0, delta).content[RUBBER, -1] / length
    assert delta[-1] == pytest.approx(turn, rel=0.01)
    assert end.imag == pytest.approx(across, rel=0.01)
    assert end.real == pytest.approx(along, rel=0.01)


def test_without_load_it_is_the_shape_of_the_bending_analysis():
    chain = Chain(STATES, STATES.law, STATES.width)
    loads = np.zeros((chain.slices, 3))
    delta = np.array([at_rest(chain, p, Surroundings(), loads) for p in STATES.pressure])
    line = chain.profile(STATES.pressure, delta)
    np.testing.assert_allclose(line, STATES.profile - STATES.profile[:, :1], atol=1e-9)


def test_a_slice_begins_at_the_clamp_and_its_content_lies_where_its_section_does():
    """Rubber in the ventral half, water in the dorsal one; a seventh of the length is clamped."""
    half, seventh = 0.5 * WIDTH * HEIGHT, LENGTH / 7
    chain = straight(70, rubber_section=half, rubber_height=HEIGHT / 4, clamped_length=seventh)
    content = chain.unloaded(np.zeros(1)).content[0]
    assert chain.arc[chain.joints[0]] == pytest.approx(seventh)
    for part, height in ((RUBBER, 1 / 4), (GAP, 3 / 4), (MIDDLE, 1 / 2)):
        assert -content[part].imag == pytest.approx(np.full(chain.slices, height * HEIGHT))
    assert content[GAP].real == pytest.approx(0.5 * chain.lengths)
    delta = np.linspace(0.1, 0.5, chain.slices)[None]
    assert chain.bend(np.zeros(1), delta) == pytest.approx(delta[:, -1])


def test_joints_and_profile_agree_under_load():
    """Rigid slices and smooth profile are the same motion, within a slice's own turn."""
    chain = Chain(STATES, STATES.law, STATES.width)
    delta = np.linspace(0, 0.5, chain.slices)[None]  # 29° in all, 1° from slice to slice
    pressure = np.array([2e4])
    line = chain.profile(pressure, delta)[0]
    joint = placed(chain.unloaded(pressure), 0, delta[0]).joint[-1]
    away = abs(complex(*line[-1]) - joint) - np.interp(2e4, chain.pressure, chain.law.neutral_axis)
    # m; half a slice's turn over half its length is 2e-5, summed over 30 slices
    assert abs(away) < 2e-4


def stroke(duration=0.2, step=1e-3, end=0.25):
    time = step * np.arange(round(end / step) + 1)
    return time, stroke_law(0.0, [(20e3, 0.005, duration)])(time)


def period(time, signal):
    """Mean time (s) between every second zero crossing."""
    before = np.flatnonzero(np.diff(np.sign(signal)) != 0)
    at = time[before] - signal[before] * np.diff(time)[before] / np.diff(signal)[before]
    return 2 * np.diff(at).mean()


def mode(chain, number):
    """Small rotations of a cantilever's first or second mode."""
    k = (1.875104, 4.694091)[number]
    s = (np.cumsum(chain.lengths) - 0.5 * chain.lengths) / LENGTH
    ratio = (np.cosh(k) + np.cos(k)) / (np.sinh(k) + np.sin(k))
    slope = np.sinh(k * s) + np.sin(k * s) - ratio * (np.cosh(k * s) - np.cos(k * s))
    return 1e-3 * slope / np.abs(slope).max()


@pytest.mark.parametrize("number, factor", [(0, 1.875104), (1, 4.694091)])
def test_frequencies_in_vacuum_are_those_of_a_beam(number, factor):
    """Euler–Bernoulli; 1 %: fifteen slices and 60 steps a period leave 0.5 %."""
    chain = straight(60, rubber_mass=MASS)
    wanted = 2 * np.pi / (factor / LENGTH) ** 2 * np.sqrt(MASS / EI)
    time = wanted / 60 * np.arange(181)
    loads = np.zeros((181, chain.slices, 3))
    delta = motion(chain, 0 * time, time[1], Surroundings(), loads, mode(chain, number))
    assert period(time, delta[:, -1]) == pytest.approx(wanted, rel=0.01)


def test_first_frequency_in_water_is_that_of_chu():
    """f/f0 = (1 + π ρ W / 4 ρc h)^(−1/2): Chu (1963) as in Sader, J. Appl. Phys. 84 (1998) 64."""
    chain = straight(60, rubber_mass=MASS)
    dry = 2 * np.pi / (1.875104 / LENGTH) ** 2 * np.sqrt(MASS / EI)
    wanted = dry * np.sqrt(1 + np.pi * 998.2 * WIDTH**2 / 4 / MASS)
    time = wanted / 60 * np.arange(181)
    around = Surroundings(0.0, 998.2, added_mass=1.0)
    delta = motion(
        chain, 0 * time, time[1], around, np.zeros((181, chain.slices, 3)), mode(chain, 0)
    )
    assert period(time, delta[:, -1]) == pytest.approx(wanted, rel=0.01)


@pytest.mark.parametrize("prescribed", [False, True])
def test_energy_closes(prescribed):
    """Work of pressure, weight and water against elastic, kinetic energy and damping."""
    chain = Chain(STATES, STATES.law, STATES.width)
    time, pressure = stroke(0.4, 0.5e-3, 0.3)
    step = time[1]
    around = Surroundings(9.81, 998.2, 0.87, 2.2, 0.004)
    loads = np.zeros((len(time), chain.slices, 3))
    loads[..., 2] = 1e-5 * np.sin(20 * time)[:, None]  # and torques of the water
    delta = 0 * loads[..., 0] if prescribed else motion(chain, pressure, step, around, loads)
    parts = energies(chain, pressure, delta, step, around, loads)
    # 1e-3: trapezoids over steps of 0.5 ms leave 2e-4
    assert open_share(parts) < 1e-3
    # its size: the finger must push water aside and bend rubber
    assert parts["pressure_work"][-1] > 0
    assert parts["water_work"][-1] < 0
    assert (np.abs(parts["elastic_energy"]).max() > 0) != prescribed
