"""The finger under a moment: linear response, table, masses and volumes by hand."""

import numpy as np
import pytest

from pipeline.fea.analyse import bend
from pipeline.fea.cell.bending_law import air, bending_law, curvatures, rubber, stiffness
from pipeline.fea.cell.path import follow
from pipeline.fea.cell.unit_cell import UnitCell
from pipeline.scene.scene import load_scene
from pipeline.structure.fea_stage import _further
from tests.finger_cell import ACTUATOR, CASE, FEA, SMALL, shipped_states


def test_stiffness_is_the_slope_of_curvature_over_moment():
    cell = UnitCell(ACTUATOR, SMALL)
    state = follow(cell, [5e3])[5e3]
    moments = 1e-6 * np.array([-1.0, 0.0, 1.0])  # 0.002 1/m of curvature: linear to 1e-5
    low, _, high = curvatures(cell, state, moments)
    assert 2e-6 / (high - low) == pytest.approx(stiffness(cell, state)[0], rel=1e-4)
    assert high > low  # a positive moment bends towards the ventral side


def test_volumes_and_masses_at_rest():
    a = ACTUATOR.model_copy(update={"wedge_deg": 0.0})
    cell = UnitCell(a, SMALL)
    cavity = a.l2 * a.h1 * (a.width - 2 * a.b1)
    section, height = air(cell, cell.rest())
    assert section == pytest.approx(cavity / a.pitch, rel=1e-9)
    assert height == pytest.approx(a.b2 + a.h1 / 2, rel=1e-9)
    block = a.pitch * (a.b2 + a.h1 + a.roof) * a.width
    gap = a.gap * (a.h1 + a.roof - a.bridge) * a.width
    mass, rubber_section, _ = rubber(cell, a)
    assert rubber_section == pytest.approx((block - gap - cavity) / a.pitch, rel=1e-9)
    assert mass == pytest.approx(a.materials.upper.density * rubber_section, rel=1e-9)


def test_table_follows_contact_that_the_stiffness_cannot():
    """Under suction the walls touch: the finger is stiffer towards the dorsal side."""
    cell = UnitCell(ACTUATOR, SMALL)
    state = follow(cell, [-2e4])[-2e4]
    law = bending_law(cell, [state], ACTUATOR, (-1.0, 0.0, 1.0))
    dorsal, ventral = np.diff(law.curvature[0])
    assert ventral > 1.3 * dorsal > 0
    assert law.curvature[0, 1] == pytest.approx(state.plane_angle / cell.x_plane)


def test_shipped_law_is_that_of_the_independent_prototype():
    """EI (mN m²) and neutral axis (mm) of a separate implementation on the same mesh."""
    shipped = shipped_states()
    assert shipped.law is not None
    kpa_ei_axis = np.array(
        [(-20, 0.560, 2.85), (-10, 0.439, 2.53), (0, 0.471, 2.33), (10, 0.484, 2.06),
         (20, 0.489, 1.76)]
    )  # fmt: skip
    for kpa, ei, axis in kpa_ei_axis:
        at = int(np.argmin(np.abs(shipped.pressure - 1e3 * kpa)))
        assert 1e3 * shipped.law.stiffness[at] == pytest.approx(ei, abs=5e-4)
        assert 1e3 * shipped.law.neutral_axis[at] == pytest.approx(axis, abs=5e-3)
        assert np.all(np.diff(shipped.law.curvature[at]) > 0)
    assert shipped.law.rubber_section * 0.070 == pytest.approx(20.0e-6, abs=0.05e-6)
    # roof and channel ± 0.5 mm are worth 16 to 18 % at the ends
    at = int(np.argmin(np.abs(shipped.pressure)))
    assert 0.1 < shipped.law.stiffness_std[at] / shipped.law.stiffness[at] < 0.3


def test_the_table_is_as_long_as_the_loads_of_the_scene_need(tmp_path):
    """A stroke that the shipped table holds, and one whose loads need more moments."""
    soft, fast = (
        load_scene(CASE, "draft", {"motion.strokes": strokes, "motion.end_time": 0.2}, tmp_path)
        for strokes in (
            [{"pressure_kpa": 20.0, "start": 0.005, "duration": 0.4}],
            [{"pressure_kpa": -20.0, "start": 0.005, "duration": 0.05},
             {"pressure_kpa": 30.0, "start": 0.1, "duration": 0.05}],
        )
    )  # fmt: skip
    states = shipped_states()
    assert _further(soft, states) == ()
    low, high = _further(fast, states)
    assert low == -high < -2.0
    analysis = FEA.model_copy(update={"mesh": SMALL})
    found = bend(ACTUATOR, analysis, pressures=np.array([-1e3, 0.0, 1e3]), turns=(-1.0, 0.0, 1.0),
                 further=lambda _: (-1.5, 1.5))  # fmt: skip
    assert found.law is not None
    np.testing.assert_allclose(found.law.moment / found.law.moment[-1], [-1, -2 / 3, 0, 2 / 3, 1])
    assert (np.diff(found.law.curvature, axis=1) > 0).all()
