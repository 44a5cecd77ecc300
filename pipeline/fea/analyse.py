"""From a pressure path of the unit cell to the bending states of the finger."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pipeline.fea.cell import plane
from pipeline.fea.cell.bending_law import TURNS, bending_law, longer
from pipeline.fea.cell.path import follow
from pipeline.fea.cell.unit_cell import NotConverged, State, UnitCell
from pipeline.fea.finger import arc_length, chain, fit_circle, smoothed
from pipeline.fea.settings import Actuator, Fea
from pipeline.formats.bending_states import BendingStates, FloatArray


def _thickness(cell: UnitCell, state: State) -> float:
    """Height (m) of the roof above the ventral surface, averaged along the roof at z = 0."""
    placed = cell.points + cell.displacement(state)
    roof, line = placed[cell.grid.top, :2], placed[cell.grid.ventral, :2]
    fine = np.linspace(line[0, 0], line[-1, 0], 400)
    surface = np.stack([fine, np.interp(fine, line[:, 0], line[:, 1])], -1)
    height = np.linalg.norm(roof[:, None] - surface[None], axis=-1).min(1)
    along = arc_length(roof)
    return float(np.trapezoid(height, along) / along[-1])


def _wall_gap(cell: UnitCell, state: State) -> float:
    """Least distance (m) between the outer walls of neighbouring chambers; 0 where they touch."""
    x, y, _ = (cell.points + cell.displacement(state))[cell.walls[0][0]].T
    distance = plane.gap(x, y, state.plane_shift, state.plane_angle, cell.x_plane)
    return 2 * max(float(distance.min()), 0.0)


def profile(cell: UnitCell, state: State, actuator: Actuator) -> FloatArray:
    """Lower surface (point, 2) of the whole finger (m)."""
    rest = cell.points[cell.grid.ventral]
    half = (rest + cell.displacement(state)[cell.grid.ventral])[:, :2]
    end = actuator.l2 / 2 + actuator.l1
    return chain(half, state.plane_angle, rest[:, 0], actuator.chambers, end)


def bend(
    actuator: Actuator,
    fea: Fea,
    done: Callable[[], object] = lambda: None,
    pressures: FloatArray | None = None,
    turns: tuple[float, ...] = TURNS,
    further: Callable[[BendingStates], tuple[float, ...]] = lambda _: (),
) -> BendingStates:
    """Converged bending states at `pressures` (Pa, else those of `fea`) by the unit cell.

    Their law of bending has the moments that would turn the finger by `turns` (rad). The bend angle
    is the arc of the fitted circle, γ = length / R, equation (6). `further`: more turns, by the
    states; those that do not converge are left out. Raises NotConverged.
    """
    cell = UnitCell(actuator, fea.mesh)
    path = follow(cell, fea.pressures if pressures is None else pressures, done)
    states = list(path.values())
    profiles = np.array([profile(cell, state, actuator) for state in states])
    radius, residual = np.array([fit_circle(line) for line in profiles]).T
    at_rest = profile(cell, cell.rest(), actuator)[:, 0]
    thickness = np.array([_thickness(cell, state) for state in states])
    found = BendingStates(
        pressure=np.array(list(path)),
        profile=smoothed(profiles, at_rest, max(1, int(actuator.length / (1.25 * actuator.pitch)))),
        thickness=np.repeat(thickness[:, None], profiles.shape[1], 1),
        bend_angle=arc_length(profiles)[:, -1] / radius,
        radius=radius,
        fit_residual=residual,
        wall_gap=np.array([_wall_gap(cell, state) for state in states]),
        converged=np.ones(len(states), dtype=np.uint8),
        width=actuator.width,
        law=bending_law(cell, states, actuator, turns) if fea.under_load else None,
    )
    if found.law is None or not (more := further(found)):
        return found
    try:
        return replace(found, law=longer(found.law, bending_law(cell, states, actuator, more)))
    except NotConverged:
        return found
