"""A guard for each interval of a run, and the verdict on the whole of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import PPoly

from fileio.errors import StageError
from fileio.formats.mesh_intervals import Interval, read_planform
from fileio.formats.node_motion import NodeMotion, read_motion
from pipeline.openfoam.displacement_files import steps_of
from pipeline.run.energy import EnergyGuard, energy_budget, energy_cause
from pipeline.run.guards import HALVE, Guard
from pipeline.run.results import finger_power
from pipeline.scene.limits import check_courant
from pipeline.scene.scene import Scene


def wall_positions(motion: NodeMotion, wall: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Positions (time, node, 2) of the nodes `wall` of a planform, m; at rest before 0."""
    shape = PPoly(motion.shape.c[:, :, wall], motion.shape.x)
    return shape(motion.pressure(np.maximum(times, 0.0)))


def guards_of(scene: Scene, intervals: tuple[Interval, ...]) -> list[Guard]:
    """What watches the solver on each interval. StageError where the Courant number is sure to be exceeded."""
    step, found = scene.numerics.time_step, []
    depth = scene.finger.width * (1.0 if scene.model.kind in ("2d", "full") else 0.5)
    for interval in intervals:
        begin = interval.begin(step)
        times = step * np.arange(steps_of(begin, step), steps_of(interval.end, step) + 1)
        wall = read_planform(scene.out, interval.mesh)["wall"].values
        positions = wall_positions(read_motion(scene.out, interval.mesh), wall, times)
        try:
            check_courant(positions, step, scene.numerics.max_courant)
        except ValueError as error:
            raise StageError(f"{scene.folder / 'scene.toml'}: {error}") from None
        budget = energy_budget(positions, begin, step, depth, scene.fluid.density)
        samples = scene.out / "case" / interval.name / "postProcessing"
        found.append(
            Guard(
                scene.numerics.max_courant,
                EnergyGuard(
                    samples,
                    scene.fluid.density,
                    scene.fluid.kinematic_viscosity,
                    finger_power,
                    budget,
                    replace(budget),
                ),
            )
        )
    return found


def energy_from_nothing(power: np.ndarray, guards: list[Guard], copies: int) -> float:
    """The largest excess of the water's energy and dissipation over the finger's work in a whole run, as a part of its
    largest energy.

    `power` (n, 4) as in power.csv, of the whole tank, which holds `copies` of the computed part. StageError where there
    is too much of it.
    """
    budgets = [guard.energy.rule for guard in guards if guard.energy]
    whole = replace(
        budgets[0],
        floor=copies * max(budget.floor for budget in budgets),
        unresolved=lambda a, b: any(budget.unresolved(a, b) for budget in budgets),
    )
    for time, rate, kinetic, dissipation in power:
        excess = whole.add(time, rate, kinetic, dissipation)
        if excess is not None:
            raise StageError(
                f"stopped at {time:g} s by a guard: {energy_cause(whole, kinetic, excess)}; the tables are kept: {HALVE}"
            )
    return whole.worst / whole.largest if whole.largest else 0.0
