"""The energy of the water against the work done on it, by sample and over a whole run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fileio.errors import StageError
from pipeline.openfoam.function_objects import table_rows, tables
from pipeline.openfoam.surface_vtk import area_vectors, read_surface

# of the largest energy so far; sound runs have 0 to 0.015
ENERGY_TOLERANCE = 0.05
# of the energy of the finger's volume of water at its peak speed: the guard ignores less
_FLOOR = 1e-3
# finer cells would make it worse
HALVE = "halve numerics.time_step, and again where it stops again"
# of the peak speed: a wall whose velocity changes by more in a time step does unsampled work
_UNRESOLVED = 0.2


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


def resolved_dissipation(
    density: float, viscosity: float, gradient: Any, half_vorticity: Any
) -> Any:
    """Power (W) that viscosity takes, from volume integrals of |grad u|^2 and half of |curl u|^2.

    2 S:S = 2 |grad u|^2 - |curl u|^2, and OpenFOAM's enstrophy is half of |curl u|^2.
    """
    return density * viscosity * (2 * gradient - 2 * half_vorticity)


def finger_power(path: Path, density: float) -> float:
    """Work rate of the computed part of the finger on the water (W) from its sampled surface."""
    surface = read_surface(path)
    pressure, shear, velocity = (
        np.asarray(surface.cell_data[name]) for name in ("p", "wallShearStress", "U")
    )
    # normals point into the finger; wallShearStress is that of the wall on the water
    area = area_vectors(surface)
    on_water = -density * (pressure[:, None] * area - shear * np.linalg.norm(area, axis=1)[:, None])
    return float(np.einsum("fi,fi->", on_water, velocity))


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
    first sample.
    """

    samples: Path
    density: float
    viscosity: float
    budget: Budget
    from_rest: bool = True
    work_rate: Callable[[Path, float], float] = finger_power  # W, of a surface and the density
    rows: int = 0

    def check(self, ended: bool = False) -> str | None:
        """The cause where the budget is violated. A sample is whole once the next one exists."""
        table = self._table()
        for time, square, gradient, half_vorticity in table[self.rows : len(table) - (not ended)]:
            surface = next(iter((self.samples / "fingerSurface").glob(f"{time:.8g}/*.vtk")), None)
            if surface is None:
                break
            self.rows += 1
            kinetic = 0.5 * self.density * square
            lost = resolved_dissipation(self.density, self.viscosity, gradient, half_vorticity)
            sample = time, self.work_rate(surface, self.density), kinetic, lost
            if self.rows == 1 and not self.from_rest:
                self.budget.begin(*sample)
                continue
            excess = self.budget.add(*sample)
            if excess is not None:
                return _energy_cause(self.budget, kinetic, excess)
        return None

    def _table(self) -> np.ndarray:
        """Rows since the last start: time, integrals of |u|^2, |grad u|^2, half of |curl u|^2."""
        parts = tables(self.samples / "volumes", "volFieldValue*.dat")
        return table_rows(parts[-1][1]) if parts else np.empty((0, 4))


def energy_budget(positions: np.ndarray, times: np.ndarray, depth: float, density: float) -> Budget:
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


def energy_from_nothing(power: np.ndarray, budgets: list[Budget], copies: int) -> float:
    """The largest excess of energy over the work in a whole run, over its largest energy.

    `power` (n, 4): power.csv, of the tank, with `copies` of the computed part; `budgets`: of the
    intervals. StageError where the excess is too large.
    """
    whole = Budget(
        copies * max(budget.floor for budget in budgets),
        lambda a, b: any(budget.unresolved(a, b) for budget in budgets),
    )
    for time, rate, kinetic, dissipation in power:
        excess = whole.add(time, rate, kinetic, dissipation)
        if excess is not None:
            raise StageError(
                f"stopped at {time:g} s by a guard: {_energy_cause(whole, kinetic, excess)};"
                f" the tables are kept: {HALVE}"
            )
    return whole.worst / whole.largest if whole.largest else 0.0
