"""Equations (1)-(6) of the paper against values worked out apart from this code."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pipeline.fea.paper_equations import bend

# P kPa, γ °, R mm for w = 24 mm, θ = 15°: the equations worked out in awk
TABLE = np.array(
    [
        (-40, -200.244, -20.0291), (-30, -152.314, -26.3318), (-20, -103.347, -38.8082),
        (-10, -53.595, -74.8336), (10, 47.1214, 85.1142), (20, 97.4823, 41.1429),
        (30, 147.441, 27.2021), (40, 196.71, 20.3889),
    ]
)  # fmt: skip


def test_table_is_reproduced_to_four_digits():
    gamma, radius = bend(TABLE[:, 0] * 1e3)
    # Half a unit of the fourth digit.
    np.testing.assert_allclose(np.rad2deg(gamma), TABLE[:, 1], rtol=5e-5)
    np.testing.assert_allclose(radius * 1e3, TABLE[:, 2], rtol=5e-5)


def test_other_cavity_width_and_the_published_bend_at_rest():
    assert abs(float(bend(20e3, width=0.028)[1]) * 1e3 - 37.9) < 0.05
    # γ changes sign where ε = 0, at P = 0.66 kPa
    assert float(bend(0.66e3)[0]) < 0 < float(bend(0.67e3)[0])


@given(st.floats(-40e3, 40e3), st.floats(0, 29))
def test_a_sharper_wedge_bends_less(pressure, wedge):
    # Equation (1): cos θ reduces the loaded area, so γ is drawn towards its value at rest.
    at_rest = float(bend(0.0)[0])
    here = float(bend(pressure, wedge_deg=wedge)[0]) - at_rest
    sharper = float(bend(pressure, wedge_deg=wedge + 1)[0]) - at_rest
    assert abs(sharper) <= abs(here) + 1e-12
