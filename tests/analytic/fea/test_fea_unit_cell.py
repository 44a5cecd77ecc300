"""The unit cell: exact derivative, symmetry, contact; the shipped states are reproduced."""

import numpy as np
import pytest

from pipeline.fea.analyse import bend, profile
from pipeline.fea.cell.path import follow
from pipeline.fea.cell.unit_cell import State, UnitCell
from pipeline.fea.finger import fit_circle
from tests.finger_cell import ACTUATOR, FEA, SMALL, shipped_states


def test_stiffness_is_the_derivative_of_the_residual():
    """With pressure, a turned plane and walls in contact on both sides."""
    cell = UnitCell(ACTUATOR, SMALL)
    generator = np.random.default_rng(1)
    unknowns = cell.rest().unknowns
    unknowns[cell.free] += generator.normal(size=len(cell.free)) * 2e-5
    outer, inner = (points for points, _ in cell.walls)
    unknowns[3 * outer] += 1.1e-3  # beyond the plane, which is 1 mm away
    unknowns[3 * inner] -= 1.6e-3  # beyond the middle of the cavity
    unknowns[-1] = 0.02
    way = np.zeros_like(unknowns)
    way[cell.free] = generator.normal(size=len(cell.free)) * 1e-9
    force, matrix = cell.residual(State(5e3, unknowns))
    forward, backward = (cell.residual(State(5e3, unknowns + sign * way))[0] for sign in (1, -1))
    difference = (forward - backward)[cell.free] / 2
    # central differences of 1e-9 m leave some 1e-6 of rounding
    small = 1e-5 * np.abs(difference).max()
    np.testing.assert_allclose((matrix @ way)[cell.free], difference, atol=small)
    assert np.abs(force).max() > 0


def test_bend_is_antisymmetric_at_small_pressures():
    """Linear elasticity knows no sign: φ(−P) = −φ(P) + O(P²)."""
    cell = UnitCell(ACTUATOR, SMALL)
    states = follow(cell, [-100.0, 100.0, 200.0])
    odd = states[100.0].plane_angle + states[-100.0].plane_angle
    assert abs(odd) < 0.01 * states[100.0].plane_angle  # 100 Pa: strains of 0.1 %
    assert states[200.0].plane_angle == pytest.approx(2 * states[100.0].plane_angle, rel=0.01)
    assert states[100.0].plane_angle > 0  # pressure bends towards the ventral side


def test_walls_do_not_pass_through_each_other():
    cell = UnitCell(ACTUATOR.model_copy(update={"wedge_deg": 0.0}), SMALL)
    state = follow(cell, [-2e4])[-2e4]
    points, _ = cell.walls[0]
    placed = (cell.points + cell.displacement(state))[points]
    beyond = (placed[:, 0] - cell.x_plane - state.plane_shift) * np.cos(state.plane_angle)
    beyond -= placed[:, 1] * np.sin(state.plane_angle)
    assert beyond.max() > 0  # they touch,
    assert beyond.max() < 2e-5  # and sink in by less than 1 % of the gap of 2 mm


@pytest.mark.slow
def test_shipped_states_are_reproduced():
    """Another machine's rounding may change the last digits, not the sixth."""
    shipped = shipped_states()
    asked = np.array([-20e3, -10e3, 10e3, 20e3])
    again = bend(ACTUATOR, FEA, pressures=asked)
    index = np.searchsorted(shipped.pressure, asked)
    np.testing.assert_allclose(again.radius, shipped.radius[index], rtol=1e-6)
    np.testing.assert_allclose(again.thickness, shipped.thickness[index], rtol=1e-6)
    # profiles are compared by their own length of 70 mm
    np.testing.assert_allclose(again.profile, shipped.profile[index], atol=1e-6 * 0.07)


@pytest.mark.slow
def test_finer_mesh_changes_the_radius_by_less_than_two_per_cent():
    """One and a half times as many elements each way, at 20 kPa."""
    radii = []
    for mesh in (FEA.mesh, FEA.mesh.refined(1.5)):
        cell = UnitCell(ACTUATOR, mesh)
        state = follow(cell, [20e3])[20e3]
        radii.append(fit_circle(profile(cell, state, ACTUATOR))[0])
    assert radii[1] == pytest.approx(radii[0], rel=0.02)
