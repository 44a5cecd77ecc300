"""Coupling of finger and water within one run: from the loads until now to the next rotations.

The structure carries the inertia of the water that moves with it (water_inertia.py), with the
flow's own acceleration; the rest of the loads is taken from the steps before. That is the method of
fictitious mass (Baek and Karniadakis, J. Comput. Phys. 231 (2012) 629), with the mass that the flow
has. Consider a mode with a structural mass m, an added mass a and a fictitious mass f. Where the
rest is the mean of the last two steps, it is stable for f > (a - m) / 2. Where the rest is
continued linearly, it is stable for f > (3 a - m) / 4.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fileio.formats.bending_states import FloatArray
from pipeline.structure.chain import Chain
from pipeline.structure.elastic_law import law_at
from pipeline.structure.energy import energies, open_share
from pipeline.structure.motion import Surroundings, advance, at_rest, motion, past, turning

# Weights of the rest now and before: linear continuation that halves what alternates, and a mean
_SECOND = np.array([1.25, 0.5, -0.75])
_FIRST = np.array([0.5, 0.5, 0.0])
_SIGNS = 8  # changes of sign in a row that show an alternating mode
_LARGE = 0.2  # of the largest load until then: smaller ones are the pressure solver's
TIP_TOLERANCE = 0.005  # of the length: largest change of the tip by one evaluation
ENERGY_TOLERANCE = 0.02  # of the pressure's work that is left open


@dataclass(frozen=True)
class Check:
    """One evaluation of the fixed point: the motion under the loads of a run."""

    tip: float  # m, by which it moves the tip at most
    open_energy: float  # over the pressure's work, until the first contact
    moment: float = 0.0  # the largest on a joint, over that of the bending law's table

    def passes(self, length: float) -> bool:
        """Whether both are within their tolerance; `length` (m): the finger's."""
        return self.tip <= TIP_TOLERANCE * length and self.open_energy <= ENERGY_TOLERANCE

    def describe(self, length: float) -> str:
        """In words, with what is allowed to a finger of `length` (m)."""
        return (
            f"under the loads of the run its tip moves by {self.tip * 1e3:.2g} mm and"
            f" {self.open_energy:.1%} of the pressure's work is open, with"
            f" {TIP_TOLERANCE * length * 1e3:.2g} mm and {ENERGY_TOLERANCE:.0%} allowed"
        )


class Coupling:
    """A coupled motion at the solver's steps, known up to a number of them.

    `pressure` (time,) Pa; `delta` (time, slice) rad; `loads` of the water and of a `contact`
    (time, slice, 3): N along and across each slice, and N m; `inertia` of the water (slice, 3,
    slice), as Surroundings'. `first_order`: how the loads are continued.
    """

    def __init__(
        self, chain: Chain, step: float, water: Surroundings, pressure: FloatArray
    ) -> None:
        """At rest at the first pressure; `step` in s."""
        self.chain, self.step, self.water, self.pressure = chain, step, water, pressure
        self.unloaded = chain.unloaded(pressure)
        self.loads = np.zeros((len(pressure), chain.slices, 3))
        self.contact = np.zeros_like(self.loads)
        self.delta = np.zeros(self.loads.shape[:2])
        self.delta[0] = at_rest(chain, float(pressure[0]), water, self.loads[0])
        self.inertia = np.zeros((chain.slices, 3, chain.slices))
        self.first_order = False

    def _rest(self, delta: FloatArray, loads: FloatArray, numbers: NDArray[np.intp]) -> FloatArray:
        """Loads (number, slice, 3) at numbered times of a motion without those of the inertia."""
        rest = loads[numbers].copy()
        for row, number in zip(rest, numbers.tolist(), strict=True):
            times = past(number)
            row += self.inertia @ turning(self.unloaded, times, delta[times], self.step)
        return rest

    def next_delta(
        self, number: int, before: tuple[FloatArray, FloatArray] | None = None
    ) -> FloatArray:
        """Rotations (slice,) rad after time `number`, up to which the motion is known.

        The contact is that of the next time. `before`: rotations and loads of a whole run, which
        guide the continuation.
        """
        numbers = np.maximum(number - np.arange(len(_SECOND)), 0)
        weights = _FIRST if self.first_order else _SECOND
        loads = np.tensordot(weights, self._rest(self.delta, self.loads, numbers), 1)
        if before is not None:
            loads += self._rest(*before, np.array([number + 1]))[0]
            loads -= np.tensordot(weights, self._rest(*before, numbers), 1)
        loads += self.contact[number + 1]
        times = past(number + 1)
        around = replace(self.water, inertia=self.inertia)
        pressure, earlier = float(self.pressure[number + 1]), self.delta[times[1:]]
        return advance(
            self.chain, self.unloaded, times, pressure, self.step, around, loads, earlier
        )

    def alternates(self, number: int) -> bool:
        """Whether the rest of the loads changes its sign from step to step, and grows."""
        if number < _SIGNS + 4:
            return False
        numbers = np.arange(number - _SIGNS - 1, number + 1)
        arm = self.chain.arc[self.chain.joints[:-1]]
        bent = np.diff(self._rest(self.delta, self.loads, numbers)[..., 1] @ arm, 2)
        half = len(bent) // 2
        until, since = np.abs(bent[:half]).max(), np.abs(bent[half:]).max()
        most = np.abs(self.loads[: number + 1, :, 1] @ arm).max()
        return bool((bent[1:] * bent[:-1] < 0).all() and since > max(until, _LARGE * most))

    def check(self) -> Check:
        """What the loads make of the whole motion; the modelled inertia leaves no trace in it."""
        chain, pressure, delta = self.chain, self.pressure, self.delta
        rest = self._rest(delta, self.loads, np.arange(len(delta))) + self.contact
        around = replace(self.water, inertia=self.inertia)
        after = motion(chain, pressure, self.step, around, rest, delta[0])
        change = chain.profile(pressure, after) - chain.profile(pressure, delta)
        # an impact takes energy within a step, in which it is not resolved
        touched = np.flatnonzero(self.contact.any(axis=(1, 2)))
        free = slice(0, touched[0] if len(touched) else None)
        parts = energies(
            chain, pressure[free], delta[free], self.step, self.water, self.loads[free]
        )
        bent = np.diff(delta, axis=1, prepend=0.0) / chain.springs
        laws = [law_at(chain.law, chain.pressure, p) for p in pressure]
        share = max(law.share(law.moment(b)) for law, b in zip(laws, bent, strict=True))
        return Check(float(np.hypot(*change[:, -1].T).max()), open_share(parts), share)
