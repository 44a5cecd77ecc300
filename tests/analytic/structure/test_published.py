"""The chain against published numbers of bodies that are no fingers; nothing is fitted to them."""

import numpy as np
import pytest

AT_REST = np.zeros(1)  # Pa: a beam has one state

# Turek and Hron (2006), tests CSM1 to CSM3: an elastic beam under gravity, clamped at one end,
# in plane strain; Featflow page fsi_csm_tests.html.
LENGTH, HEIGHT, DENSITY, POISSON, GRAVITY = 0.35, 0.02, 1000.0, 0.4, 2.0
SOFT, STIFF = 1.4e6, 5.6e6  # Pa, Young's modulus of CSM1 and CSM3, and of CSM2
SWING = (-63.607e-3, 65.160e-3, 1.0995)  # CSM3 across: mean and amplitude, m, and frequency, Hz
PERIODS = 10  # of CSM3 that are computed


@pytest.mark.parametrize("name", ["CSM1", "CSM2"])
def test_beam_under_its_weight(name):
    """1.5 %: the chain does not shear: 0.4 % of the displacement across, twice that along."""
    np.testing.assert_allclose(known.at_rest_under_gravity(name), known.TIP[name], rtol=0.015)


def test_beam_that_swings():
    """2 % of the amplitude, for shear and damping of higher modes; 0.5 % of the frequency."""
    mean, amplitude, frequency = known.swing(5e-3)
    assert mean == pytest.approx(known.SWING[0], rel=0.02)
    assert amplitude == pytest.approx(known.SWING[1], rel=0.02)
    assert frequency == pytest.approx(known.SWING[2], rel=0.005)


def test_blades_in_a_current():
    """8 %: the published law is itself a fit of unknown error; its powers of the speed hold too."""
    table = known.blades()
    np.testing.assert_allclose(table["chain"], table["published"], rtol=0.08)
    stiff = table[table["buoyancy"] == 0].set_index("cauchy")["chain"]
    # drag ~ U² l_e ~ U^(4/3): Ca ~ U²
    power = 2 + 2 * np.log(stiff[1000.0] / stiff[300.0]) / np.log(1000 / 300)
    assert power == pytest.approx(4 / 3, abs=0.02)
