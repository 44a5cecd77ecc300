"""What stops a run that has gone wrong, while it runs: the log's numbers, the energy balance (pipeline.run.energy), silence."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable

from pipeline.run.energy import EnergyGuard

MAX_CONTINUITY = 1e-2  # sum of the local errors per step; a sound run has 1e-5 or less
MAX_PRESSURE_ITERATIONS = 1000  # OpenFOAM's own limit for one solution
UNSOLVED_STEPS = 5  # steps in a row whose pressure does not converge
SILENCE = 900.0  # s without a line from the solver

FINER = "lower numerics.time_step or refine the mesh"
HALVE = "halve numerics.time_step, and again where it stops again"  # finer cells would make it worse


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
        return self.look()

    def look(self, ended: bool = False) -> str | None:
        """The energy's verdict on the samples so far, all of them once the solver has `ended`."""
        cause = self.energy.look(ended) if self.energy else None
        if cause:
            self.remedy = HALVE
        return cause


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
