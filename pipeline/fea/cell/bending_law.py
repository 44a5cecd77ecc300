"""How a unit cell bends under a moment, and what its rubber and its air weigh and displace."""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import splu

from fileio.formats.bending_states import BendingLaw
from pipeline.fea.cell.unit_cell import FloatArray, NotConverged, State, UnitCell
from pipeline.fea.settings import Actuator

# Moments of the table, as turns (rad) of the whole finger that they would cause at the stiffness at rest
TURNS = (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)
LEAST_PART = 1 / 64  # of a step of the table, where Newton's method does not take it at once


def compliance(cell: UnitCell, state: State) -> FloatArray:
    """Derivative (2, 2) of the plane's shift u (m) and turn φ (rad) by force (N) and moment (N m) on the whole width."""
    _, matrix = cell.residual(state)
    unit = np.zeros((len(cell.free), 2))
    unit[-2, 0] = unit[-1, 1] = 0.5  # the cell is half the width
    return np.asarray(splu(matrix[cell.free][:, cell.free].tocsc()).solve(unit)[-2:])


def stiffness(cell: UnitCell, state: State) -> tuple[float, float]:
    """Bending stiffness EI (N m²), and the height (m) of the neutral axis above the ventral surface."""
    by_moment = compliance(cell, state)[:, 1]
    return float(cell.x_plane / by_moment[1]), float(-by_moment[0] / by_moment[1])


def curvatures(cell: UnitCell, state: State, moments: FloatArray) -> FloatArray:
    """Curvature (moment,) 1/m, per length at rest, under ascending `moments` (N m); raises NotConverged."""
    curvature = {}
    for branch in (moments[moments >= 0], moments[moments < 0][::-1]):
        at = state
        for moment in branch:
            at = _loaded(cell, at, float(moment))
            curvature[float(moment)] = at.plane_angle / cell.x_plane
    return np.array([curvature[float(moment)] for moment in moments])


def _loaded(cell: UnitCell, state: State, moment: float) -> State:
    """Equilibrium under `moment`, in smaller steps where Newton's method fails."""
    whole = step = moment - state.moment
    while state.moment != moment:
        last = abs(moment - state.moment) <= abs(step)
        try:
            state = cell.solve(state, state.pressure, moment if last else state.moment + step)
        except NotConverged:
            step /= 2
            if abs(step) < LEAST_PART * abs(whole):
                raise NotConverged(
                    f"the unit cell does not converge at {state.pressure / 1e3:g} kPa under {moment:.2g} N m: narrow the"
                    " pressures in [fea], or go without the law of bending with under_load = false"
                ) from None
    return state


def rubber(cell: UnitCell, actuator: Actuator) -> tuple[float, float, float]:
    """Mass (kg/m) and section (m²) of the rubber per length, and the height (m) of its centre of mass over the ventral surface."""
    mass = volume = first = 0.0
    for body, material in zip(
        cell.bodies, (actuator.materials.lower, actuator.materials.upper), strict=True
    ):
        region = body.field.region
        height = np.einsum("aqc,ca->qc", region.h, cell.points[region.mesh.cells, 1])
        volume += float(region.dV.sum())
        mass += material.density * float(region.dV.sum())
        first += material.density * float((region.dV * height).sum())
    per_length = 2 / cell.x_plane  # from half the width and half a pitch
    return per_length * mass, per_length * volume, first / mass


def air(cell: UnitCell, state: State) -> tuple[float, float]:
    """Section (m²) of the chambers' air per length at rest, and the height (m) of its centre over the ventral surface.

    By Gauss' theorem, from the forces of a unit pressure on the walls: on the planes of symmetry x or z is 0.
    """
    place = cell.points + cell.displacement(state)
    cell.pressure.field[0].values[:] = cell.displacement(state)
    force = cell.pressure.assemble.vector(cell.pressure.field, 1.0).toarray().reshape(-1, 3)
    volume = float((force * place).sum()) / 3
    first = float((force[:, 1] * place[:, 1] ** 2).sum()) / 2
    return abs(volume) * 2 / cell.x_plane, first / volume


def bending_law(
    cell: UnitCell, states: list[State], actuator: Actuator, turns: tuple[float, ...]
) -> BendingLaw:
    """The law of the finger over its states (state,), under moments that would turn it by `turns` (rad); raises NotConverged."""
    stiff, axis = np.array([stiffness(cell, state) for state in states]).T
    at_rest, _ = stiffness(cell, cell.rest())
    moments = np.array(turns) * at_rest / actuator.length
    mass, section, height = rubber(cell, actuator)
    air_section, air_height = np.array([air(cell, state) for state in states]).T
    return BendingLaw(
        stiffness=stiff,
        neutral_axis=axis,
        moment=moments,
        curvature=np.array([curvatures(cell, state, moments) for state in states]),
        clamped_length=actuator.l2 / 2 + actuator.l1,
        rubber_mass=mass,
        rubber_section=section,
        rubber_height=height,
        air_section=air_section,
        air_height=air_height,
    )
