"""What stops a run that has gone wrong, while it runs: the log's numbers, the energy balance, silence."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

MAX_CONTINUITY = 1e-2  # sum of the local errors per step; a sound run has 1e-5 or less
MAX_PRESSURE_ITERATIONS = 1000  # OpenFOAM's own limit for one solution
UNSOLVED_STEPS = 5  # steps in a row whose pressure does not converge
ENERGY_TOLERANCE = (
    0.05  # of the largest energy so far; sound runs: 0, and 0.001 where the flow changes meshes
)
FLOOR = (
    1e-3  # of the energy that the finger's volume of water has at its peak speed: below it nothing is judged
)
UNRESOLVED = (
    0.2  # part of the peak speed by which a wall may change within one time step for its work to be sampled
)
SILENCE = 900.0  # s without a line from the solver

FINER = "lower numerics.time_step or refine the mesh"


class Guard:
    """Reads the solver's log line by line and says when a run has gone wrong; `remedy` goes with the last verdict."""

    def __init__(self, max_courant: float, energy: EnergyGuard | None = None) -> None:
        self.max_courant = max_courant
        self.energy = energy
        self.time = 0.0
        self.remedy = FINER
        self._unsolved = 0
        self._iterations = 0

    def verdict(self, line: str) -> str | None:
        """None while all is well, else the cause in a few words."""
        if line.startswith("Time = "):
            self.time = float(line.split("=")[1])
            return self._step()
        if line.startswith("Courant Number"):
            courant = float(line.split()[-1])
            if not courant <= self.max_courant:
                return f"Courant number {courant:.3g} exceeds numerics.max_courant = {self.max_courant:g}"
        elif line.startswith("time step continuity errors"):
            local = float(re.split(r"[=,]", line)[1])
            if not local < MAX_CONTINUITY:
                return f"continuity error {local:.3g}"
        elif "Solving for" in line:
            if re.search(r"residual = [-+]?(nan|inf)", line):
                return f"the equations for {line.split('Solving for ')[1].split(',')[0]} have no number for a solution"
            if "Solving for p," in line:
                self._iterations = max(self._iterations, int(line.split()[-1]))
        return None

    def _step(self) -> str | None:
        """What a new time step says of the one before it."""
        self._unsolved = self._unsolved + 1 if self._iterations >= MAX_PRESSURE_ITERATIONS else 0
        self._iterations = 0
        if self._unsolved >= UNSOLVED_STEPS:
            return f"the pressure did not converge in {UNSOLVED_STEPS} steps in a row"
        return self.energy.look() if self.energy else None


@dataclass
class Budget:
    """Kinetic energy against the work done, as both come in: energy from nothing is what may never happen.

    The water's energy less the work done on it can only fall, by what is dissipated. Where it rises above the least
    that it has had by more than a tolerance, energy has come from nothing. Work between two samples is taken at the
    larger of their two powers, so that what the samples miss of a peak is not held against a run.
    `floor`: energy (J) below which nothing is judged; `unresolved(a, b)`: whether the wall jumps between two times.
    """

    floor: float
    unresolved: Callable[[float, float], bool] = lambda a, b: False
    time: float = 0.0
    power: float = 0.0
    kinetic: float = 0.0
    work: float = 0.0
    largest: float = 0.0
    least: float = 0.0
    worst: float = 0.0  # energy from nothing so far, J

    def begin(self, time: float, power: float, kinetic: float) -> None:
        """Take what is there at the start."""
        self.time, self.power, self.kinetic = time, power, kinetic
        self.largest = self.least = kinetic

    def add(self, time: float, power: float, kinetic: float) -> float | None:
        """Take the next sample (s, W, J); the energy from nothing (J) where there is too much of it, else None."""
        if not (np.isfinite(power) and np.isfinite(kinetic)):
            return np.inf
        step = time - self.time
        self.work += step * max(power, self.power) if step > 0 else 0.0
        jumped = self.unresolved(self.time, time)
        self.time, self.power, self.kinetic = time, power, kinetic
        balance = kinetic - self.work
        self.least = balance if jumped else min(self.least, balance)
        self.largest = max(self.largest, kinetic, abs(self.work))
        excess = balance - self.least
        self.worst = max(self.worst, excess)
        return excess if excess > ENERGY_TOLERANCE * self.largest + self.floor else None


def energy_cause(kinetic: float, excess: float) -> str:
    """What a budget's verdict means."""
    if not np.isfinite(excess):
        return "the water's energy is not a number"
    return f"the water has {kinetic:.3g} J of kinetic energy, {excess:.3g} J more than the finger's work accounts for"


@dataclass
class EnergyGuard:
    """Follows the samples that the solver writes to `samples` (postProcessing), and holds the energy against the work.

    `work_rate(path, density)`: power (W) of a sampled surface of the finger; `rule`: the budget before any sample, `budget`
    that of the solver's present start; `from_rest`: the water is at rest when the
    solver starts, else the first sample is what the budget begins with.
    """

    samples: Path
    density: float
    work_rate: Callable[[Path, float], float]
    rule: Budget  # as it is before the first sample
    budget: Budget
    from_rest: bool = True
    rows: int = 0

    def look(self, ended: bool = False) -> str | None:
        """None while all is well, else the cause. A sample is read when the next one is there: then it is whole."""
        table = self._table()
        for time, square in table[self.rows : len(table) if ended else max(len(table) - 1, 0)]:
            surface = next(iter((self.samples / "fingerSurface").glob(f"{time:.8g}/*.vtk")), None)
            if surface is None:
                break
            self.rows += 1
            sample = time, self.work_rate(surface, self.density), 0.5 * self.density * square
            if self.rows == 1 and not self.from_rest:
                self.budget.begin(*sample)
                continue
            excess = self.budget.add(*sample)
            if excess is not None:
                return energy_cause(sample[2], excess)
        return None

    def _table(self) -> list[tuple[float, float]]:
        """Times and integrals of |u|^2 of this leg's newest table; a line that is not whole is left out."""
        found = list((self.samples / "volumes").glob("*/volFieldValue*.dat"))
        if not found:
            return []
        newest = max(found, key=lambda path: float(path.parent.name))
        rows = []
        for line in newest.read_text(errors="replace").splitlines(keepends=True):
            words = line.split()
            if line.endswith("\n") and len(words) >= 2 and line[0] != "#":
                rows.append((float(words[0]), float(words[1])))
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


class Watchdog:
    """Calls `bark` once when `fed` was not called for `limit` s of a machine that is awake."""

    TICK = 5.0  # s; a sleep that lasts much longer was the machine's or the job's, not the solver's

    def __init__(self, limit: float, bark: Callable[[], None]) -> None:
        self.limit, self.bark, self.barked = limit, bark, False
        self._quiet = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def fed(self) -> None:
        """A sign of life."""
        self._quiet = 0.0

    def _watch(self) -> None:
        tick = min(self.TICK, self.limit / 4)
        while not self._over.wait(tick):
            self._quiet += tick
            if self._quiet > self.limit:
                self.barked = True
                self.bark()
                return

    def __enter__(self) -> Watchdog:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
