"""Hyperelastic laws against their closed forms for incompressible tension."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.fea.materials import LAWS, strain_energy
from pipeline.fea.settings import Material

MOONEY_RIVLIN = {"C10": 134.2e3, "C01": 33.6e3}
YEOH = {"C10": 36e3, "C20": 258.0, "C30": 0.56}
SAMPLES = {
    "neo_hooke": {"mu": 1e5},
    "mooney_rivlin": MOONEY_RIVLIN,
    "yeoh": YEOH,
    "ogden": {"mu": [1e5, 2e4], "alpha": [1.7, -1.5]},
    "third_order_deformation": {"C10": 5e4, "C01": 1e4, "C11": 1e3, "C20": -1e3, "C30": 1e2},
    "arruda_boyce": {"C1": 1e5, "limit": 3.2},
    "extended_tube": {"Gc": 1.9e5, "Ge": 1.4e5, "delta": 0.01, "beta": 0.11},
    "alexander": {"C1": 1e5, "C2": 1e5, "C3": 1e4, "gamma": 0.1, "k": 0.01},
    "anssari_benam_bucchi": {"mu": 3e5, "N": 20.0},
    "lopez_pamies": {"mu": [3e5, 1e5], "alpha": [1.0, -2.0]},
}
STRETCHES = np.linspace(0.6, 2.5, 39)


def material(law):
    return Material(law=law, parameters=SAMPLES[law], bulk=1e9)


def nominal_stress(law, stretches, powers):
    """Nominal stress along axis 0 for F = diag(λ^powers), with axis 2 free of stress."""
    gradient = np.zeros((3, 3, 1, len(stretches)))
    for axis, power in enumerate(powers):
        gradient[axis, axis, 0] = stretches**power
    stress = strain_energy(material(law)).gradient([gradient, None])[0]
    first, free = (stress[axis, axis, 0] * gradient[axis, axis, 0] for axis in (0, 2))
    return (first - free) / stretches  # the pressure that incompressibility leaves open cancels


def expected(law, stretches, invariant, slope, mooney_rivlin_factor):
    if law == "mooney_rivlin":
        return 2 * slope * (MOONEY_RIVLIN["C10"] + MOONEY_RIVLIN["C01"] * mooney_rivlin_factor)
    excess = invariant - 3
    return 2 * slope * (YEOH["C10"] + 2 * YEOH["C20"] * excess + 3 * YEOH["C30"] * excess**2)


@pytest.mark.parametrize("law", ["mooney_rivlin", "yeoh"])
def test_uniaxial_tension(law):
    x = STRETCHES
    stress = nominal_stress(law, x, (1, -0.5, -0.5))
    closed = expected(law, x, x**2 + 2 / x, x - x**-2, 1 / x)
    # Both are evaluated in double precision; 1e-6 of the largest stress is asked for.
    np.testing.assert_allclose(stress, closed, rtol=1e-6, atol=1e-6 * np.abs(closed).max())


@pytest.mark.parametrize("law", ["mooney_rivlin", "yeoh"])
def test_equibiaxial_tension(law):
    x = STRETCHES
    stress = nominal_stress(law, x, (1, 1, -2))
    closed = expected(law, x, 2 * x**2 + x**-4, x - x**-5, x**2)
    np.testing.assert_allclose(stress, closed, rtol=1e-6, atol=1e-6 * np.abs(closed).max())


def test_every_law_has_a_sample():
    assert set(SAMPLES) == set(LAWS)


@pytest.mark.parametrize("law", LAWS)
@given(seed=st.integers(0, 2**16))
def test_isochoric_part_makes_no_pressure(law, seed):
    gradient = np.eye(3)[:, :, None, None] + 0.2 * np.random.default_rng(seed).uniform(
        -1, 1, (3, 3, 1, 4)
    )
    stress = strain_energy(material(law)).gradient([gradient, None])[0]
    trace = np.einsum("iJqc,iJqc->qc", stress, gradient)
    # Ogden and the extended tube perturb equal stretches by about 1e-6 to tell them apart.
    assert np.abs(trace).max() < 1e-4 * max(np.abs(stress).max(), 1e3)


def test_unknown_law_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match=r"hooke_1678.*mooney_rivlin"):
        strain_energy(Material(law="hooke_1678", parameters={}, bulk=1e6))
