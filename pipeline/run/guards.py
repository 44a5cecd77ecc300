"""Guards that stop a run gone wrong: the solver's log, the energy balance, and silence."""

from __future__ import annotations

import re
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.interpolate import PPoly

from fileio.formats.mesh_intervals import Interval, read_planform
from fileio.formats.node_motion import read_motion
from pipeline.openfoam.displacement_files import PADDING, Steps
from pipeline.run.energy import HALVE, EnergyGuard, energy_budget
from pipeline.scene.limits import check_courant

_MAX_CONTINUITY = 1e-2  # sum of the local errors per step; a sound run has 1e-5 or less
_MAX_PRESSURE_ITERATIONS = 1000  # OpenFOAM's own limit for one solution
_UNSOLVED_STEPS = 5  # steps in a row whose pressure does not converge
SILENCE = 900.0  # s without a line from the solver
_LONG_STEP = (60.0, 50.0)  # s, and times the median step: one that exceeds both does not end
_FIRST_STEP = 3600.0  # s: the longest first step, which has none before it

FINER = "lower numerics.time_step or refine the mesh"


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


def guard_of(
    out: Path, interval: Interval, steps: Steps, max_courant: float, depth: float, density: float,
    viscosity: float,
) -> Guard:  # fmt: skip
    """The guard of one mesh interval in the level's folder `out`; SI, `depth` as in energy_budget.

    ValueError where the motion of the wall is sure to exceed `max_courant`.
    """
    times = steps.times[:-PADDING]
    motion, wall = read_motion(out, interval.mesh), read_planform(out, interval.mesh)["wall"].values
    positions = PPoly(motion.shape.c[:, :, wall], motion.shape.x)(
        motion.pressure(np.maximum(times, 0.0))
    )
    check_courant(positions, times, max_courant)
    budget = energy_budget(positions, times, depth, density)
    samples = out / "case" / interval.name / "postProcessing"
    return Guard(max_courant, EnergyGuard(samples, density, viscosity, budget))


class Watchdog:
    """Calls `stop` once when the solver is silent for `limit` s or a time step does not end.

    Only time of an awake machine counts. `cause` names the reason.
    """

    TICK = 5.0  # s

    def __init__(self, limit: float, stop: Callable[[], None]) -> None:
        self.limit, self.stop = limit, stop
        self.cause: str | None = None
        self._quiet = self._step = 0.0
        self._begun = False  # the first time step
        self._steps: deque[float] = deque(maxlen=101)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def reset(self) -> None:
        """The solver has written a line."""
        self._quiet = 0.0

    def advance(self) -> None:
        """The solver has begun another time step."""
        if self._begun:  # what ends with the first is the start-up
            self._steps.append(self._step)
        self._begun = True
        self._step = 0.0

    def longest_step(self) -> float:
        """The longest duration (s) of this time step."""
        least, factor = _LONG_STEP
        if not self._steps:
            return _FIRST_STEP
        return max(least, factor * float(np.median(list(self._steps))))

    def check(self, passed: float) -> str | None:
        """The cause of a stop after another `passed` s, else None."""
        self._quiet += passed
        self._step += passed
        if self._quiet > self.limit:
            return f"the solver has written nothing for {self.limit / 60:g} minutes"
        if self._step > self.longest_step():
            if not self._steps:
                return f"the solver's first time step has not ended after {self._step:.0f} s"
            return (
                f"a time step has taken {self._step:.0f} s and has not ended, longer than"
                f" {_LONG_STEP[1]:g} others"
            )
        return None

    def _watch(self) -> None:
        tick = min(self.TICK, self.limit / 4)
        while self.cause is None and not self._over.wait(tick):
            self.cause = self.check(tick)
        if self.cause:
            self.stop()

    def __enter__(self) -> Watchdog:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
