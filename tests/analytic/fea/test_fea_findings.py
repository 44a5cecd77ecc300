"""The shipped bending states are whole and agree with the paper's equations."""

import numpy as np
import pytest

from pipeline.fea.envelope import crosses_itself, outline
from pipeline.fea.paper_equations import bend as paper_bend
from pipeline.fea.paper_equations import describes
from tests.finger_cell import ACTUATOR, shipped_states

STATES = shipped_states()


def test_default_agrees_with_the_papers_equations():
    """Within 15 %; the heights of roof and channel are chosen for it."""
    kpa = STATES.pressure / 1e3
    there = (np.abs(kpa) > 5.5) & (kpa > -20.5)
    expected = paper_bend(STATES.pressure[there])[1]
    assert STATES.radius[there] == pytest.approx(expected, rel=0.15)


def test_shipped_states_are_whole():
    assert (np.diff(STATES.pressure) > 0).all()
    assert STATES.converged.all()
    assert (STATES.thickness > 0).all()
    # chord error of cubic splines: 0.15 mm
    assert np.abs(np.diff(np.rad2deg(STATES.bend_angle))).max() < 7.5
    outlines = map(outline, STATES.profile, STATES.thickness)
    assert not any(crosses_itself(polygon) for polygon in outlines)
    assert STATES.wall_gap is not None
    assert (np.diff(STATES.wall_gap[STATES.pressure <= 0]) >= 0).all()  # suction closes the gaps
    assert np.isfinite(STATES.radius_std[STATES.pressure != 0]).all()
    sources = STATES.about["uncertainty"]["curvature_std"]
    assert sources.keys() >= {"pressure ± 0.2 kPa", "mesh 1.5 × finer"}


def test_the_papers_equations_are_of_its_actuator_alone():
    """The page draws them for no other."""
    paper = ACTUATOR.model_dump()
    assert describes(paper)
    assert describes(paper | {"roof": 0.003})  # they do not know the roof
    assert not any(describes(paper | change) for change in ({"width": 0.02}, {"chambers": 6}))
    assert not describes({})
