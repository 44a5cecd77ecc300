"""How a unit cell bends under a moment, and what its rubber and its air weigh and displace."""

from dataclasses import replace

import numpy as np
from scipy.sparse.linalg import splu

from pipeline.fea.cell.unit_cell import NotConverged, State, UnitCell
from pipeline.fea.settings import Actuator
from pipeline.formats.bending_states import BendingLaw, FloatArray

# Moments of the table, as turns (rad) of the whole finger at the stiffness at rest
TURNS = (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)
_LEAST_PART = 1 / 64  # of a step of the table, where Newton's method does not take it at once


def stiffness(cell: UnitCell, state: State) -> tuple[float, float]:
    """Bending stiffness EI (N m²), and the height (m) of the neutral axis."""
    _, matrix = cell.residual(state)
    unit = np.zeros(len(cell.free))
    unit[-1] = 0.5  # the cell is half the width
    shift, turn = splu(matrix[cell.free][:, cell.free].tocsc()).solve(unit)[-2:]
    return float(cell.x_plane / turn), float(-shift / turn)


def curvatures(cell: UnitCell, state: State, moments: FloatArray) -> FloatArray:
    """Curvature (moment,) 1/m, per length at rest, under ascending `moments` (N m).

    Raises NotConverged.
    """
    curvature = {}
    for branch in (moments[moments >= 0], moments[moments < 0][::-1]):
        at = state
        for moment in branch.tolist():
            at = _loaded(cell, at, moment)
            curvature[moment] = at.plane_angle / cell.x_plane
    return np.array([curvature[moment] for moment in moments.tolist()])


def _loaded(cell: UnitCell, state: State, moment: float) -> State:
    """Equilibrium under `moment`, in smaller steps where Newton's method fails."""
    whole = step = moment - state.moment
    while state.moment != moment:
        last = abs(moment - state.moment) <= abs(step)
        try:
            state = cell.solve(state, state.pressure, moment if last else state.moment + step)
        except NotConverged:
            step /= 2
            if abs(step) < _LEAST_PART * abs(whole):
                raise NotConverged(
                    f"the unit cell does not converge at {state.pressure / 1e3:g} kPa under"
                    f" {moment:.2g} N m: narrow the pressures in [fea], or go without the law of"
                    " bending with under_load = false"
                ) from None
    return state


def rubber(cell: UnitCell, actuator: Actuator) -> tuple[float, float, float]:
    """Mass (kg/m) and section (m²) of the rubber, and the height (m) of its centre of mass."""
    mass = volume = first = 0.0
    layers = actuator.materials.lower, actuator.materials.upper
    for body, material in zip(cell.bodies, layers, strict=True):
        region = body.field.region
        height = np.einsum("aqc,ca->qc", region.h, cell.points[region.mesh.cells, 1])
        volume += float(region.dV.sum())
        mass += material.density * float(region.dV.sum())
        first += material.density * float((region.dV * height).sum())
    per_length = 2 / cell.x_plane  # from half the width and half a pitch
    return per_length * mass, per_length * volume, first / mass


def air(cell: UnitCell, state: State) -> tuple[float, float]:
    """Section (m²) of the chambers' air per length at rest, and the height (m) of its centre.

    By Gauss' theorem, from the forces of a unit pressure on the walls.
    """
    moved = cell.displacement(state)
    place = cell.points + moved
    cell.pressure.field[0].values[:] = moved
    force = cell.pressure.assemble.vector(cell.pressure.field, 1.0).toarray().reshape(-1, 3)
    volume = float((force * place).sum()) / 3
    first = float((force[:, 1] * place[:, 1] ** 2).sum()) / 2
    return abs(volume) * 2 / cell.x_plane, first / volume


def bending_law(
    cell: UnitCell, states: list[State], actuator: Actuator, turns: tuple[float, ...]
) -> BendingLaw:
    """The law over `states`, under moments that would turn the finger by `turns` (rad).

    Raises NotConverged.
    """
    stiff, axis = np.array([stiffness(cell, state) for state in states]).T
    moments = np.array(turns) * stiffness(cell, cell.rest())[0] / actuator.length
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


def longer(law: BendingLaw, other: BendingLaw) -> BendingLaw:
    """A law with the moments of another as well."""
    moment = np.concatenate([law.moment, other.moment])
    order = np.argsort(moment)
    curvature = np.concatenate([law.curvature, other.curvature], axis=1)
    return replace(law, moment=moment[order], curvature=curvature[:, order])
