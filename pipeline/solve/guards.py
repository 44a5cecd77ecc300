"""Guards that stop a run gone wrong: the solver's log, and the energy balance."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy import ndarray
from scipy.interpolate import PPoly

from pipeline.formats.mesh_intervals import IntervalMesh
from pipeline.openfoam.displacement_files import PADDING, Steps
from pipeline.openfoam.function_objects import table_rows, tables
from pipeline.openfoam.through_flow import power_through
from pipeline.scene.sections import Fluid
from pipeline.solve.power import finger_power, resolved_dissipation
from piv.files.errors import StageError

_MAX_CONTINUITY = 1e-2  # sum of the local errors per step; a sound run has 1e-5 or less
_MAX_PRESSURE_ITERATIONS = 1000  # OpenFOAM's own limit for one solution
_UNSOLVED_STEPS = 5  # steps in a row whose pressure does not converge
FINER = "lower numerics.time_step or refine the mesh"
# of the largest energy so far; sound runs have 0 to 0.015
ENERGY_TOLERANCE = 0.05
# of the energy of the finger's volume of water at its peak speed: the guard ignores less
_FLOOR = 1e-3
# finer cells would make it worse
HALVE = "halve numerics.time_step, and again where it stops again"
# of the power that is exchanged; the shipped scenes have at most 0.01
_UNEXPLAINED, _UNEXPLAINED_LIMIT = 0.05, 0.15
# Error of peak force and impulse by the square of `force_change`, and the largest error without a
# warning; docs/reference/tuned.csv. What they miss: docs/stability/drawn.csv
_ERROR_OF_CHANGE, _WRONG = 2.0, 0.11
# of the peak speed: a wall whose velocity changes by more in a time step does unsampled work
_UNRESOLVED = 0.2
# Courant number of a run over that of its wall along a cell: the flow round the tip is faster, its
# cells are smaller. Measured: 2.8 to 5.1 over levels, models, strokes and the pinch.
_COURANT_OF_FLOW = (2.5, 4.0)


@dataclass
class Budget:
    """Detects energy that no work accounts for, sample by sample.

    Kinetic plus dissipated energy less the work can only fall, by what the schemes dissipate. Where
    it rises above its least value by more than a tolerance, the numerical solution has produced
    energy. Between two samples the larger power and the smaller dissipation count, so that a peak
    between them stops no run. `floor` (J): a smaller excess is ignored; `unresolved(a, b)`: whether
    the wall's velocity jumps between two times.
    """

    floor: float
    unresolved: Callable[[float, float], bool] = lambda a, b: False
    time: float = 0.0
    power: float = 0.0
    dissipation: float = 0.0
    work: float = 0.0
    dissipated: float = 0.0
    largest: float = 0.0
    least: float = 0.0
    worst: float = 0.0  # energy from nothing so far, J

    def begin(self, time: float, power: float, kinetic: float, dissipation: float) -> None:
        """Take the first sample."""
        self.time, self.power, self.dissipation = time, power, dissipation
        self.largest = self.least = kinetic

    def add(self, time: float, power: float, kinetic: float, dissipation: float) -> float | None:
        """Take the next sample (s, W, J, W); the excess of energy (J) where it is too large."""
        if not np.isfinite([power, kinetic, dissipation]).all():
            return np.inf
        step = max(time - self.time, 0.0)
        self.work += step * max(power, self.power)
        self.dissipated += step * min(dissipation, self.dissipation)
        jumped = self.unresolved(self.time, time)
        self.time, self.power, self.dissipation = time, power, dissipation
        balance = kinetic + self.dissipated - self.work
        self.least = balance if jumped else min(self.least, balance)
        self.largest = max(self.largest, kinetic, abs(self.work))
        excess = balance - self.least
        self.worst = max(self.worst, excess)
        return excess if excess > ENERGY_TOLERANCE * self.largest + self.floor else None


def _energy_cause(budget: Budget, kinetic: float, excess: float) -> str:
    """The cause of a stop as a sentence."""
    if not np.isfinite(excess):
        return "the water's energy is not a number"
    return (
        f"the power balance does not close: the water has {kinetic:.3g} J of kinetic energy and has"
        f" dissipated {budget.dissipated:.3g} J, {excess:.3g} J more than the finger's work"
        " accounts for"
    )


@dataclass
class EnergyGuard:
    """Compares energy and work in the solver's `samples` (postProcessing).

    `density` (kg/m³), `viscosity` (m²/s): of the fluid. Not `from_rest`: the budget begins with the
    first sample. `current`: whether water runs through the tank's ends, with power of its own.
    """

    samples: Path
    density: float
    viscosity: float
    budget: Budget
    from_rest: bool = True
    work_rate: Callable[[Path, float], float] = finger_power  # W, of a surface and the density
    current: bool = False
    rows: int = 0

    def check(self, ended: bool = False) -> str | None:
        """The cause where the budget is violated. A sample is whole once the next one exists."""
        table, through = self._table(), None
        if self.current:
            through = power_through(self.samples, self.density)
            known = through[-1, 0] if len(through) else -1.0
            table = table[table[:, 0] <= known * (1 + 1e-9)]
        for time, square, gradient, half_vorticity in table[self.rows : len(table) - (not ended)]:
            surface = next(iter((self.samples / "fingerSurface").glob(f"{time:.8g}/*.vtk")), None)
            if surface is None:
                break
            self.rows += 1
            kinetic = 0.5 * self.density * square
            lost = resolved_dissipation(self.density, self.viscosity, gradient, half_vorticity)
            power = self.work_rate(surface, self.density)
            if through is not None:
                power += float(np.interp(time, *through.T))
            sample = time, power, kinetic, lost
            if self.rows == 1 and not self.from_rest:
                self.budget.begin(*sample)
                continue
            excess = self.budget.add(*sample)
            if excess is not None:
                return _energy_cause(self.budget, kinetic, excess)
        return None

    def _table(self) -> ndarray:
        """Rows since the last start: time, integrals of |u|^2, |grad u|^2, half of |curl u|^2."""
        parts = tables(self.samples / "volumes", "volFieldValue*.dat")
        return table_rows(parts[-1][1]) if parts else np.empty((0, 4))


def energy_budget(positions: ndarray, times: ndarray, depth: float, density: float) -> Budget:
    """The budget of a run with wall nodes, in order, at `positions` (time, node, 2) m, `times` s.

    `depth` (m): the finger's extent in z within the computed part.
    """
    velocity = np.diff(positions, axis=0) / np.diff(times)[:, None, None]
    peak = float(np.hypot(velocity[..., 0], velocity[..., 1]).max(initial=0.0))
    change = np.diff(velocity, axis=0, prepend=0 * velocity[:1])
    jumps = np.hypot(change[..., 0], change[..., 1]).max(axis=1) > _UNRESOLVED * peak
    x, y = positions[0].T
    area = 0.5 * abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))

    def unresolved(after: float, until: float) -> bool:
        return bool(jumps[(times[1:] > after + 1e-9) & (times[:-1] < until + 1e-9)].any())

    return Budget(_FLOOR * 0.5 * density * peak**2 * area * depth, unresolved, time=float(times[0]))


def energy_from_nothing(
    power: ndarray, budgets: list[Budget], copies: int, running: bool = False
) -> float:
    """The largest excess of energy over the work in a whole run, over its largest energy.

    `power` (n, 4): power.csv, of the tank, with `copies` of the computed part, and with what a
    current brings; `budgets`: of the intervals; `running`: whether the flow runs at 0 s. StageError
    where the excess is too large.
    """
    whole = Budget(
        copies * max(budget.floor for budget in budgets),
        lambda a, b: any(budget.unresolved(a, b) for budget in budgets),
    )
    if running:
        whole.begin(*power[0])
    for time, rate, kinetic, dissipation in power[int(running) :]:
        excess = whole.add(time, rate, kinetic, dissipation)
        if excess is not None:
            raise StageError(
                f"stopped at {time:g} s by a guard: {_energy_cause(whole, kinetic, excess)};"
                f" the tables are kept: {HALVE}"
            )
    return whole.worst / whole.largest if whole.largest else 0.0


def power_warning(share: float, budgets: list[Budget], time_step: float) -> str:
    """Return a warning where too much of the power is unexplained, else "".

    `share`: `unexplained_share` of the power balance; `time_step`, s. StageError above the limit.
    The work of a wall whose velocity jumps between two samples is not known: it has no limit.
    """
    if share <= _UNEXPLAINED:
        return ""
    text = (
        f"{100 * share:.0f} % of the power that the water takes is unexplained, so that forces may"
        f" be as wrong; lower numerics.time_step = {time_step:g}, or smooth a measured pressure"
        " (motion.smoothing)"
    )
    jumps = any(budget.unresolved(-np.inf, np.inf) for budget in budgets)
    if share > _UNEXPLAINED_LIMIT and not jumps:
        raise StageError(f"stopped by a guard: {text}; the tables are kept")
    return text


def force_change(force: ndarray) -> float:
    """Change of a force (step, axis) from step to step over the force, both RMS.

    Of an oscillation its phase over a step, rad: the error of the time scheme goes with its square.
    """
    size = float((force**2).sum())
    return float(np.sqrt((np.diff(force, axis=0) ** 2).sum() / size)) if size else 0.0


def step_warning(force: ndarray, time_step: float) -> str:
    """Return a warning where `time_step` (s) does not resolve a force (step, axis), else ""."""
    change = force_change(force)
    error = _ERROR_OF_CHANGE * change**2
    if error <= _WRONG:
        return ""
    return (
        f"the force changes by {100 * change:.0f} % of itself in a time step, so that peak force"
        f" and impulse may be {100 * min(error, 1.0):.0f} % wrong; lower numerics.time_step ="
        f" {time_step:g} to {time_step * np.sqrt(0.02 / error):.1g}"
    )


class Guard:
    """Checks the solver's log line by line; `remedy` belongs to the last verdict."""

    def __init__(self, max_courant: float, energy: EnergyGuard | None = None) -> None:
        self.max_courant = max_courant
        self.energy = energy
        self.time = 0.0
        self.remedy = FINER
        self._unsolved = 0
        self._iterations = 0

    def verdict(self, line: str) -> str | None:
        """The cause where a line of the log shows that the run has gone wrong, else None."""
        if line.startswith("Time = "):
            self.time = float(line.split("=")[1])
            return self._step()
        if line.startswith("Courant Number"):
            courant = float(line.split()[-1])
            if not courant <= self.max_courant:
                return (
                    f"Courant number {courant:.3g} exceeds numerics.max_courant ="
                    f" {self.max_courant:g}"
                )
        elif line.startswith("time step continuity errors"):
            local = float(re.split(r"[=,]", line)[1])
            if not local < _MAX_CONTINUITY:
                return f"continuity error {local:.3g}"
        elif line.startswith("Unknown function type"):  # OpenFOAM only warns, and records nothing
            self.remedy = "install the whole of that OpenFOAM, then run make again"
            return f"OpenFOAM has no function object {line.split()[-1]}"
        elif "Solving for" in line:
            if re.search(r"residual = [-+]?(nan|inf)", line):
                field = line.split("Solving for ")[1].split(",")[0]
                return f"the equations for {field} have no number for a solution"
            if "Solving for p," in line:
                self._iterations = max(self._iterations, int(line.split()[-1]))
        return None

    def _step(self) -> str | None:
        """The verdict on the time step that has just ended."""
        self._unsolved = self._unsolved + 1 if self._iterations >= _MAX_PRESSURE_ITERATIONS else 0
        self._iterations = 0
        if self._unsolved >= _UNSOLVED_STEPS:
            return f"the pressure did not converge in {_UNSOLVED_STEPS} steps in a row"
        return self.check_energy()

    def check_energy(self, ended: bool = False) -> str | None:
        """The verdict of the energy balance: on all samples once the solver has `ended`."""
        cause = self.energy.check(ended) if self.energy else None
        if cause:
            self.remedy = HALVE
        return cause


def check_courant(positions: ndarray, times: ndarray, max_courant: float) -> float:
    """The Courant number to be expected of a moving wall.

    `positions` (step, node, 2) m: wall nodes in order along the outline at even `times` (s).
    ValueError where it is sure to exceed `max_courant`.
    """
    ahead = np.roll(positions, -1, axis=1) - positions
    edge = np.hypot(ahead[..., 0], ahead[..., 1])
    size = np.minimum(edge, np.roll(edge, 1, axis=1))[:-1]
    moved = np.diff(positions, axis=0)
    walk = np.hypot(moved[..., 0], moved[..., 1])
    along = walk / size
    at = np.unravel_index(int(np.argmax(along)), along.shape)
    low, likely = (factor * float(along[at]) for factor in _COURANT_OF_FLOW)
    if low > max_courant:
        time_step = times[1] - times[0]
        raise ValueError(
            f"the finger's wall moves at {walk[at] / time_step:.2g} m/s along cells of"
            f" {size[at]:.2g} m: a Courant number of about {likely:.2g}, more than"
            f" numerics.max_courant = {max_courant:g}; give a numerics.time_step of at most"
            f" {time_step * max_courant / likely:.2g} s (now {time_step:g} s), or larger"
            " mesh.wall_cell and tip_cell"
        )
    return likely


def guard_of(
    case: Path,
    mesh: IntervalMesh,
    steps: Steps,
    max_courant: float,
    depth: float,
    fluid: Fluid,
    current: bool = False,
) -> Guard:
    """The guard of one mesh interval; `depth` as in energy_budget, `current` as of EnergyGuard.

    ValueError where the motion of the wall is sure to exceed `max_courant`.
    """
    times = steps.times[:-PADDING]
    wall, shape = mesh.planform["wall"].values, mesh.motion.shape
    pressure = mesh.motion.pressure(np.maximum(times, 0.0))
    positions = PPoly(shape.c[:, :, wall], shape.x)(pressure)
    budget = energy_budget(positions, times, depth, fluid.density)
    energy = EnergyGuard(
        case / "postProcessing", fluid.density, fluid.kinematic_viscosity, budget, current=current
    )
    check_courant(positions, times, max_courant)
    return Guard(max_courant, energy)
