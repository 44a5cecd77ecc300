"""The paper's findings about bending, in the shipped states and studies (`make fea`, `python -m pipeline fea-studies`)."""

from pathlib import Path

import numpy as np
import pytest

from fileio.formats.bending_states import read
from pipeline.fea.envelope import crosses_itself, outline
from pipeline.fea.paper_equations import bend as paper_bend
from pipeline.fea.studies.tables import at, read_table

ROOT = Path(__file__).parents[3]
RESULTS = ROOT / "cases" / "single_finger" / "kinematics" / "studies"
STUDIES = read_table(RESULTS / "studies.csv")
CALCULIX = read_table(RESULTS / "calculix.csv")
STATES = read(ROOT / "cases" / "single_finger" / "kinematics" / "states.h5")
WEDGES = [f"theta_{w}" for w in (0, 5, 10, 15, 20, 25, 30)]


def radius_mm(pressure_kpa):
    return float(STATES.radius[np.flatnonzero(STATES.pressure == 1e3 * pressure_kpa)[0]] * 1e3)


@pytest.mark.parametrize("name", STUDIES)
def test_radius_falls_as_pressure_grows(name):
    b = STUDIES[name]
    for side in (b.pressure > 0, b.pressure < 0):
        order = np.argsort(np.abs(b.pressure[side]))
        assert (np.diff(np.abs(b.radius[side][order])) < 0).all()


@pytest.mark.parametrize("pressure_kpa", [10, 20, 30, 40])
def test_wedge_matters_little_to_15_degrees_and_much_beyond(pressure_kpa):
    radii = np.array([at(STUDIES[name], pressure_kpa) for name in WEDGES])
    assert (np.diff(radii) > 0).all()
    # The paper says "a little" and "significantly": below 10 % to 15°, above 40 % to 30°.
    assert radii[3] < 1.10 * radii[0]
    assert radii[6] > 1.40 * radii[3]


def saturation_kpa(name):
    """Least suction (kPa) from which the curvature stays within 90 % of that at −40 kPa."""
    b = STUDIES[name]
    suction = b.pressure < 0
    share = b.radius[0] / b.radius[suction]
    return float(-b.pressure[suction][share >= 0.9].max() / 1e3)


def test_chambers_touch_in_the_order_of_their_wedge():
    pressures = [saturation_kpa(name) for name in ("theta_0", "theta_5", "theta_10")]
    assert pressures[0] < pressures[1] < pressures[2]
    # The paper's missing points begin at −10, −20 and −30 kPa; it has a point every 10 kPa, the study every 5.
    np.testing.assert_allclose(pressures, [10, 20, 30], atol=10)
    assert STUDIES["theta_0"].wall_gap[STUDIES["theta_0"].pressure == -10e3] == 0


@pytest.mark.parametrize("pressure_kpa", [-40, -30, -20, -10, 10, 20, 30, 40])
def test_wider_bends_more(pressure_kpa):
    radii = [abs(at(STUDIES[f"width_{w}"], pressure_kpa)) for w in (12, 20, 28)]
    assert radii[0] > radii[1] > radii[2]


@pytest.mark.parametrize("pressure_kpa", [-20, -10, 10, 20])
def test_softness_of_the_upper_layer_outweighs_that_of_the_lower(pressure_kpa):
    both, upper, lower = (
        abs(at(STUDIES[name], pressure_kpa)) for name in ("u30_l30", "u10_l30", "u30_l10")
    )
    assert upper < lower < both
    assert 1 / upper - 1 / both > 2 * (1 / lower - 1 / both)


@pytest.mark.parametrize("pressure_kpa", [*range(-20, -5), *range(6, 41)])
def test_default_agrees_with_the_papers_equations(pressure_kpa):
    # The bound, for −20…40 kPa and |P| > 5 kPa; the roof's and channel's heights are chosen for it.
    assert radius_mm(pressure_kpa) == pytest.approx(
        float(paper_bend(1e3 * pressure_kpa)[1]) * 1e3, rel=0.15
    )


def test_unit_cell_agrees_with_the_whole_finger_in_3d():
    (solid,) = CALCULIX.values()
    assert list(solid.pressure) == [10e3, 20e3, 30e3]
    for pressure, radius in zip(solid.pressure, solid.radius, strict=True):
        assert radius_mm(pressure / 1e3) == pytest.approx(
            radius * 1e3, rel=0.02
        )  # as much as a finer mesh may change it
    assert (
        solid.wall_gap <= 1e-4
    ).all()  # third column: rms residual of the circle fit; bound: 0.1 mm


def test_shipped_states_are_whole():
    assert (np.diff(STATES.pressure) > 0).all()
    assert STATES.converged.all()
    assert (STATES.thickness > 0).all()
    assert (
        np.abs(np.diff(np.rad2deg(STATES.bend_angle))).max() < 7.5
    )  # chord error of cubic splines: 0.15 mm
    assert not any(
        crosses_itself(outline(line, high))
        for line, high in zip(STATES.profile, STATES.thickness, strict=True)
    )
    assert STATES.wall_gap is not None
    assert (np.diff(STATES.wall_gap[STATES.pressure <= 0]) >= 0).all()  # suction closes the gaps
    assert np.isfinite(STATES.radius_std[STATES.pressure != 0]).all()
    assert set(STATES.about["uncertainty"]["curvature_std"]) >= {
        "pressure ± 0.2 kPa",
        "mesh 1.5 × finer",
    }
