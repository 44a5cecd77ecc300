"""Loads on slices lose nothing; a stiffness in place of the analysis."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from pipeline.formats.bending_states import States, read
from pipeline.formats.finger_loads import motion_sentence, read_loads
from pipeline.kinematics import stage as kinematics
from pipeline.scene.scene import load_scene
from pipeline.structure import stage
from pipeline.structure.chain import MIDDLE, RUBBER, Chain
from pipeline.structure.elastic_law import bending_law, constant_law, law_at
from pipeline.structure.finger import ElasticFinger, Posed
from pipeline.structure.motion import Surroundings, motion
from tests.conftest import CASES

STATES = read(CASES / "single_finger" / "kinematics" / "states.h5")
LENGTH, EI = 0.07, 0.48e-3


def straight(**law):
    line = np.stack([np.linspace(0, LENGTH, 125), np.zeros(125)], -1)
    states = States(
        np.array([-1e3, 0.0, 1e3]), np.repeat(line[None], 3, 0), np.full((3, 125), 0.0167)
    )
    return Chain(states, replace(constant_law(EI, 0.0, 3), **law), 0.028)


def test_no_force_and_no_moment_is_lost():
    chain = Chain(STATES, STATES.law, STATES.width)
    pressure = np.array([2e4])
    still = np.zeros((1, chain.slices))
    water = Surroundings()
    finger = ElasticFinger(chain, None, np.eye(2), np.zeros(2), water, water, water, True)
    posed = Posed(finger, 2e4, still[0])
    at = posed.placed
    profile = chain.profile(pressure, still)[0]
    points = profile[:, 0] + 1j * profile[:, 1]
    points = 0.5 * (points[1:] + points[:-1])  # between the joints
    generator = np.random.default_rng(3)
    force = generator.normal(size=124) + 1j * generator.normal(size=124)
    place = points - finger.places(np.zeros((1, 2)))  # the chain begins at its ventral edge
    loads = posed.of_forces(*(np.column_stack([z.real, z.imag]) for z in (place, force)))
    along, torque = loads[:, 0] + 1j * loads[:, 1], loads[:, 2]
    heading = np.concatenate([[1.0], at.heading])
    assert np.sum(along * heading) == pytest.approx(force.sum())
    clamped = np.arange(124) < chain.joints[0]
    assert along[0] == pytest.approx(force[clamped].sum())
    # about any point: forces at the slices' middles and their torques do what the faces' forces do
    own = torque[1:] + (np.conj(at.content[MIDDLE]) * (along * heading)[1:]).imag
    assert own.sum() == pytest.approx((np.conj(points) * force).imag[~clamped].sum())


def test_given_stiffness_takes_the_place_of_the_analysis():
    law = bending_law(STATES, 1e-3)
    joint = law_at(law, STATES.pressure, -2e4)
    np.testing.assert_allclose(joint([-1.0, 0.0, 0.5]), [-1e-3, 0.0, 5e-4], atol=1e-12)
    assert law.rubber_mass == STATES.law.rubber_mass
    plain = States(STATES.pressure, STATES.profile, STATES.thickness)
    assert bending_law(plain, None) is None
    assert bending_law(plain, 1e-3).rubber_mass == 0


def test_a_solid_finger_of_a_density_bends_about_its_middle():
    height, width = 0.0167, 0.028
    line = np.stack([np.linspace(0, LENGTH, 125), np.zeros(125)], -1)
    states = States(np.arange(3.0), np.repeat(line[None], 3, 0), np.full((3, 125), height))
    law = bending_law(states, 1e-3, 1100.0, width)
    assert law.rubber_mass == pytest.approx(1100.0 * height * width)
    np.testing.assert_allclose(law.neutral_axis, height / 2)
    chain = Chain(states, law, width)
    assert chain.gap_section == 0
    rubber, middle = chain.unloaded(np.zeros(1)).content[0, [RUBBER, MIDDLE]]
    np.testing.assert_allclose(rubber, middle)


def test_water_on_the_mount_loads_no_slice():
    chain, water = straight(), Surroundings()
    finger = ElasticFinger(
        chain, lambda t: 0 * t, np.eye(2), np.zeros(2), water, water, water, True, mounted=True
    )
    posed = Posed(finger, 0.0, np.zeros(chain.slices))
    place, force = np.array([[-0.02, 0.01], [0.03, 0.0]]), np.array([[1.0, 2.0], [0.0, 3.0]])
    loads = posed.of_forces(place, force)
    assert loads[0, :2] == pytest.approx([1.0, 2.0])
    assert np.hypot(*loads[1:, :2].sum(0)) == pytest.approx(3.0, rel=0.05)


def test_a_motion_that_is_not_computed_leaves_the_loads_and_its_reason(tmp_path, monkeypatch):
    """As f90's in the heavy water of a plane, which ended the run without a page."""
    scene = load_scene(CASES / "single_finger", "smoke", {"motion.end_time": 0.1}, tmp_path)
    kinematics.run(scene, quiet=True)
    monkeypatch.setattr(stage, "_measured_loads", lambda *_: {"time": np.zeros(2)})
    monkeypatch.setattr(stage, "motion", partial(motion, most=1e-3))
    stage.run(scene, quiet=True)
    found = read_loads(tmp_path / "loads.h5")
    assert "bears a moment far beyond the table" in found.attrs["unknown"]
    assert "bend_in_water" not in found
    coupled = dict(found.attrs) | {
        "coupled": 1, "alternated": 0, "tip_change": 0.0, "open_energy": 0.0, "moment_share": 1.0,
        "contact_force": 0.5, "contact_impulse": 0.012,
    }  # fmt: skip
    assert "make the finger's motion together" in motion_sentence(coupled)
    assert "with at most 0.5 N, and with 0.012 N s in all." in motion_sentence(coupled)
    assert "as a line" not in motion_sentence(coupled)
    assert "as a line for 0.02 s, its tip" in motion_sentence(coupled | {"alternated": 0.02})
    assert motion_sentence(coupled).endswith(str(found.attrs["unknown"]))
