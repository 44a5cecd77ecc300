"""Coupling of finger and water within one run: from the loads until now to the next rotations.

The structure carries the inertia of the water that moves with it (water_inertia.py), with the
flow's own acceleration; the rest of the loads is taken from the steps before. That is the method of
fictitious mass (Baek and Karniadakis, J. Comput. Phys. 231 (2012) 629), with the mass that the flow
has. Consider a mode with a structural mass m, an added mass a and a fictitious mass f. Each step
multiplies it by the roots z of z^4 = q (w0 z^3 + w1 z^2 + w2 z + w3), where q = (f - a) / (m + f)
and w are the weights of the rest at the last steps. With a parabola it is stable for
-0.43 < q < 0.55, thus for f > 0.70 a - 0.30 m and f < 2.2 a + 1.2 m; with a line of least squares
for -1 < q < 1, thus for f > (a - m) / 2. The mean of two steps would be stable for
f > (a - 2 m) / 3, but it lags.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from pipeline.formats.bending_states import FloatArray
from pipeline.structure.chain import Chain
from pipeline.structure.energy import energies, open_share
from pipeline.structure.motion import (
    Surroundings,
    advance,
    at_rest,
    felt,
    past,
    turning,
)

# Weights of the rest now and before: they continue a parabola and double what alternates; the line
# of least squares through four steps keeps it as it is
_PARABOLA = np.array([2.375, -1.125, -0.875, 0.625])
_LINE = np.array([1.0, 0.5, 0.0, -0.5])
_SIGNS = 8  # second differences in a row whose signs change that show an alternating mode
# of the root's moment by the water's inertia, where the mode counts and where it has ceased; what
# the pressure solver leaves at the start is a thousandth
_LARGE, _SMALL = 0.2, 0.02
TIP_TOLERANCE = 0.005  # of the length: largest change of the tip by one evaluation
ENERGY_TOLERANCE = 0.02  # of the work that is left open


@dataclass(frozen=True)
class Check:
    """One evaluation of the fixed point: the motion under the loads of a run."""

    tip: float  # m, by which it moves the tip at most
    open_energy: float  # over the work, as of energy.open_share
    moment: float = 0.0  # the largest on a joint, over that of the bending law's table

    def fault(self, length: float) -> str:
        """What a finger of `length` (m) is not allowed, in words; empty where all is well."""
        if self.tip <= TIP_TOLERANCE * length and self.open_energy <= ENERGY_TOLERANCE:
            return ""
        return (
            f"under the loads of the run its tip moves by {self.tip * 1e3:.2g} mm and"
            f" {self.open_energy * 100:.1f} % of the work is unexplained, with"
            f" {TIP_TOLERANCE * length * 1e3:.2g} mm and {ENERGY_TOLERANCE * 100:.0f} % allowed"
        )


class Coupling:
    """A coupled motion at the solver's steps, known up to a number of them.

    `pressure` (time,) Pa; `delta` (time, slice) rad; `loads` of the water and of a `contact`
    (time, slice, 3): N along and across each slice, and N m; `rest`: of the water's loads without
    those of the `inertia` (time, slice, 3, slice + 1), by which the step to that time was made: as
    Surroundings', and last by the pressure's second derivative at fixed headings, N s²/Pa and
    N m s²/Pa. `alternating`: steps from whose end on the rest was continued as a line.
    """

    def __init__(
        self,
        chain: Chain,
        step: float,
        water: Surroundings,
        pressure: FloatArray,
        running: bool = False,
        passage: int | None = None,
    ) -> None:
        """At rest at the first pressure; `step` in s; `running`: in water that flows at 0 s.

        The finger is then held until the first step has given the stream's loads at 0 s. `passage`:
        time steps over which the motion is checked; None: all.
        """
        self.chain, self.step, self.water, self.pressure = chain, step, water, pressure
        self._running, self._passage = running, passage
        self.unloaded = chain.unloaded(pressure)
        self.loads = np.zeros((len(pressure), chain.slices, 3))
        self.contact, self.rest = np.zeros_like(self.loads), np.zeros_like(self.loads)
        self.delta = np.zeros(self.loads.shape[:2])
        self.delta[0] = at_rest(chain, float(pressure[0]), water, self.loads[0])
        self.inertia = np.zeros((*self.loads.shape, chain.slices + 1))
        self.alternating: list[int] = []
        # (time, slice + 1): angular accelerations, and the pressure's second derivative
        every = [past(number) for number in range(len(pressure))]
        still = np.zeros((len(every[0]), chain.slices))
        self._unloaded_rates = np.array(
            [
                np.append(turning(self.unloaded, times, still, step), felt(pressure[times], step))
                for times in every
            ]
        )

    def _by_pressure(self, number: int) -> FloatArray:
        """Loads (slice, 3) of the walls' acceleration at fixed headings."""
        return -self.inertia[number, ..., -1] * felt(self.pressure[past(number)], self.step)

    def take(self, number: int, loads: FloatArray) -> None:
        """The water's loads (slice, 3) at time `number`, up to which the motion is known."""
        times = past(number)
        rate = turning(self.unloaded, times, self.delta[times], self.step)
        turned = self.inertia[number, ..., :-1] @ rate
        self.loads[number] = loads
        self.rest[number] = loads + turned - self._by_pressure(number)
        if self._running and number == 1:
            self.rest[0] = self.rest[1]

    def _moved(self, number: int, rest: FloatArray, delta: FloatArray) -> FloatArray:
        """Rotations (slice,) at time `number` after those of `delta` (time, slice), rad."""
        times = past(number)
        around = replace(self.water, inertia=self.inertia[number, ..., :-1])
        loads = rest + self._by_pressure(number) + self.contact[number]
        pressure, before = float(self.pressure[number]), delta[times[1:]]
        return advance(self.chain, self.unloaded, times, pressure, self.step, around, loads, before)

    def next_delta(self, number: int) -> FloatArray:
        """Rotations (slice,) rad after time `number`, up to which the loads are known.

        The contact is that of the next time.
        """
        weights = _LINE if number in self.alternating else _PARABOLA
        before = np.maximum(number - np.arange(len(weights)), 0)
        return self._moved(number + 1, np.tensordot(weights, self.rest[before], 1), self.delta)

    def choose_order(self, number: int) -> None:
        """Continue the rest as a line while it changes its sign from step to step, and grows.

        The mean of the last two would also stop the mode, but it lags by 1.5 steps, which fed the
        flutter of a flag. The mode counts above a share of what the water's inertia loads in the
        motion by the pressure alone. An inertia that is far from the water's causes it: once the
        mode has ceased and the inertia is learnt anew, the rest is a parabola again.
        """
        if not _SIGNS + 4 <= number < len(self.rest) - 1:
            return
        arm = self.chain.arc[self.chain.joints[:-1]]
        bent = np.diff(self.rest[number - _SIGNS - 1 : number + 1, :, 1] @ arm, 2)
        half = len(bent) // 2
        until, since = np.abs(bent[:half]).max(), np.abs(bent[half:]).max()
        large = self._inertial_moment(number)
        if self._running:  # a current may move what the pressure does not
            large += float(np.median(np.abs(self.loads[1 : number + 1, :, 1] @ arm)))
        grows = (bent[1:] * bent[:-1] < 0).all() and since > max(until, _LARGE * large)
        anew = not np.array_equal(self.inertia[number], self.inertia[number + 1])
        ceased = anew and max(until, since) < _SMALL * large
        if grows or (number - 1 in self.alternating and not ceased):
            self.alternating.append(number)

    def _inertial_moment(self, number: int) -> float:
        """Largest moment (N m) about the root of the water's inertia, in the unloaded motion.

        With the inertia as it is known at time `number`.
        """
        arm = self.chain.arc[self.chain.joints[:-1]]
        by_turning = arm @ self.inertia[number, :, 1]
        return float(np.abs(self._unloaded_rates @ by_turning).max())

    def check(self) -> Check:
        """What the loads make of the whole motion. One inertia serves all steps; any would do.

        With passages the motion begins anew from the run's own after each. The water's damping is
        not in this computation, so that an error in step with a flutter would grow by periods.
        """
        chain, pressure, delta, passage = self.chain, self.pressure, self.delta, self._passage
        once = copy(self)
        once.rest = np.zeros_like(self.rest)
        once.inertia = np.broadcast_to(self.inertia[-1], self.inertia.shape)
        for number in range(1, len(delta)):
            once.take(number, self.loads[number])
        starts = (0, passage // 2) if passage else (0,)
        tip = max(once._moved_by_loads(passage, start) for start in starts)
        loads = self.loads + self.contact
        parts = energies(chain, pressure, delta, self.step, self.water, loads)
        share = chain.share(chain.moments(pressure, delta))
        return Check(tip, open_share(parts, passage), share)

    def _moved_by_loads(self, passage: int | None, start: int) -> float:
        """Largest distance (m) of the tip from the run's, under the rest of the loads at each time.

        The motion begins anew at step `start` and after each `passage`.
        """
        chain, pressure, delta = self.chain, self.pressure, self.delta
        after, known = delta.copy(), delta.copy()
        for number in range(2 if self._running else 1, len(delta)):
            if passage and number % passage == start:
                known[:number] = delta[:number]
            known[number] = after[number] = self._moved(number, self.rest[number], known)
        change = chain.profile(pressure, after) - chain.profile(pressure, delta)
        return float(np.hypot(*change[:, -1].T).max())
