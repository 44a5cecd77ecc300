"""Energy from nothing: the water's energy held against the work done on it, at every sample and over a whole run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ENERGY_TOLERANCE = (
    0.05  # of the largest energy so far; sound runs: 0 to 0.015, the most where a step covers 16 cells
)
FLOOR = (
    1e-3  # of the energy that the finger's volume of water has at its peak speed: below it nothing is judged
)
UNRESOLVED = (
    0.2  # part of the peak speed by which a wall may change within one time step for its work to be sampled
)


@dataclass
class Budget:
    """Energy against the work done, as both come in: energy from nothing is what may never happen.

    What the water has of kinetic energy and has dissipated, less the work done on it, can only fall: by what the schemes
    dissipate. Where it rises above the least that it has had by more than a tolerance, energy has come from nothing.
    Without the dissipation a flow that is fed at a wall and dissipates that at once would pass. Between two samples work
    is taken at the larger of their powers and dissipation at the smaller, so that what the samples miss of a peak is not
    held against a run.
    `floor`: energy (J) below which nothing is judged; `unresolved(a, b)`: whether the wall jumps between two times.
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
        """Take what is there at the start."""
        self.time, self.power, self.dissipation = time, power, dissipation
        self.largest = self.least = kinetic

    def add(self, time: float, power: float, kinetic: float, dissipation: float) -> float | None:
        """Take the next sample (s, W, J, W); the energy from nothing (J) where there is too much of it, else None."""
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


def resolved_dissipation(density: float, viscosity: float, gradient: Any, half_vorticity: Any) -> Any:
    """Power (W) that viscosity takes from the resolved flow, of the volume integrals of |grad u|^2 and half of |curl u|^2.

    2 S:S = 2 |grad u|^2 - |curl u|^2, and OpenFOAM's enstrophy is half of |curl u|^2.
    """
    return density * viscosity * (2 * gradient - 2 * half_vorticity)


def energy_cause(budget: Budget, kinetic: float, excess: float) -> str:
    """What a budget's verdict means."""
    if not np.isfinite(excess):
        return "the water's energy is not a number"
    return (
        f"the power balance does not close: the water has {kinetic:.3g} J of kinetic energy and has dissipated"
        f" {budget.dissipated:.3g} J, {excess:.3g} J more than the finger's work accounts for"
    )


@dataclass
class EnergyGuard:
    """Follows the samples that the solver writes to `samples` (postProcessing), and holds the energy against the work.

    `viscosity` (m²/s) is the fluid's; `work_rate(path, density)`: power (W) of a sampled surface of the finger; `rule`: the budget before any sample, `budget`
    that of the solver's present start; `from_rest`: the water is at rest when the
    solver starts, else the first sample is what the budget begins with.
    """

    samples: Path
    density: float
    viscosity: float
    work_rate: Callable[[Path, float], float]
    rule: Budget  # as it is before the first sample
    budget: Budget
    from_rest: bool = True
    rows: int = 0

    def look(self, ended: bool = False) -> str | None:
        """None while all is well, else the cause. A sample is read when the next one is there: then it is whole."""
        table = self._table()
        for time, square, gradient, half_vorticity in table[
            self.rows : len(table) if ended else max(len(table) - 1, 0)
        ]:
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
                return energy_cause(self.budget, kinetic, excess)
        return None

    def _table(self) -> list[tuple[float, float, float, float]]:
        """Times and integrals of |u|^2, |grad u|^2 and half of |curl u|^2 of this interval's newest table; a line that is not
        whole is left out."""
        found = list((self.samples / "volumes").glob("*/volFieldValue*.dat"))
        if not found:
            return []
        newest = max(found, key=lambda path: float(path.parent.name))
        rows = []
        for line in newest.read_text(errors="replace").splitlines(keepends=True):
            words = line.split()
            if line.endswith("\n") and len(words) == 4 and line[0] != "#":
                time, square, gradient, half_vorticity = map(float, words)
                rows.append((time, square, gradient, half_vorticity))
        return rows


def wall_steps(positions: np.ndarray, time_step: float) -> tuple[float, np.ndarray]:
    """Peak speed (m/s) of wall positions (step, node, 2) one time step apart, and the steps within which the velocity
    of a node jumps by more than UNRESOLVED of it (step,)."""
    velocity = np.diff(positions, axis=0) / time_step
    peak = float(np.hypot(velocity[..., 0], velocity[..., 1]).max(initial=0.0))
    change = np.diff(velocity, axis=0, prepend=0 * velocity[:1])
    jump = np.hypot(change[..., 0], change[..., 1]).max(axis=1)
    return peak, jump > UNRESOLVED * peak


def energy_budget(
    positions: np.ndarray, start: float, time_step: float, depth: float, density: float
) -> Budget:
    """The budget of a run whose wall nodes, in order along the outline, take `positions` (step, node, 2) from `start` on.

    `depth` (m) is the finger's extent in z within the computed part.
    """
    peak, jumps = wall_steps(positions, time_step)
    x, y = positions[0].T
    area = 0.5 * abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))
    times = start + time_step * np.arange(1, len(jumps) + 1)

    def unresolved(after: float, until: float) -> bool:
        within = (times > after + 1e-9) & (times - time_step < until + 1e-9)
        return bool(jumps[within].any())

    return Budget(FLOOR * 0.5 * density * peak**2 * area * depth, unresolved, time=start)
