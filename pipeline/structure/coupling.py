"""Coupling of finger and water within one run: from the loads until now to the next rotations.

The structure carries the inertia of the water that moves with it (water_inertia.py), with the
flow's own acceleration; the rest of the loads is taken from the steps before. That is the method of
fictitious mass (Baek and Karniadakis, J. Comput. Phys. 231 (2012) 629), with the mass that the flow
has. Consider a mode with a structural mass m, an added mass a and a fictitious mass f. Each step
multiplies it by the roots z of z^4 = q (w0 z^3 + w1 z^2 + w2 z + w3), where q = (f - a) / (m + f)
and w are the weights of the rest at the last steps. With a parabola it is stable for
-0.43 < q < 0.55, thus for f > 0.70 a - 0.30 m; with a mean for -2 < q < 1, thus for
f > (a - 2 m) / 3.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fileio.formats.bending_states import FloatArray
from pipeline.structure.chain import Chain
from pipeline.structure.energy import energies, open_share
from pipeline.structure.motion import (
    Surroundings,
    advance,
    at_rest,
    felt,
    motion,
    past,
    turning,
)

# Weights of the rest now and before: they continue a parabola and double what alternates; a mean
_PARABOLA = np.array([2.375, -1.125, -0.875, 0.625])
_MEAN = np.array([0.5, 0.5, 0.0, 0.0])
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

    def fault(self, length: float) -> str:
        """What a finger of `length` (m) is not allowed, in words; empty where all is well."""
        if self.tip <= TIP_TOLERANCE * length and self.open_energy <= ENERGY_TOLERANCE:
            return ""
        return (
            f"under the loads of the run its tip moves by {self.tip * 1e3:.2g} mm and"
            f" {self.open_energy:.1%} of the pressure's work is open, with"
            f" {TIP_TOLERANCE * length * 1e3:.2g} mm and {ENERGY_TOLERANCE:.0%} allowed"
        )


class Coupling:
    """A coupled motion at the solver's steps, known up to a number of them.

    `pressure` (time,) Pa; `delta` (time, slice) rad; `loads` of the water and of a `contact`
    (time, slice, 3): N along and across each slice, and N m; `inertia` of the water (slice, 3,
    slice + 1): as Surroundings', and last by the pressure's second derivative at fixed headings,
    N s²/Pa and N m s²/Pa. `first_order`: whether the loads are continued as their mean.
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
        self.inertia = np.zeros((chain.slices, 3, chain.slices + 1))
        self.first_order = False

    @property
    def _around(self) -> Surroundings:
        return replace(self.water, inertia=self.inertia[..., :-1])

    def _of_pressure(self, numbers: NDArray[np.intp]) -> FloatArray:
        """Loads (number, slice, 3) of the walls' acceleration at fixed headings."""
        times = np.array([past(number) for number in numbers.tolist()])
        return np.multiply.outer(felt(self.pressure[times.T], self.step), -self.inertia[..., -1])

    def _rest(self, numbers: NDArray[np.intp]) -> FloatArray:
        """Loads (number, slice, 3) at numbered times without those of the inertia."""
        rest = self.loads[numbers] - self._of_pressure(numbers)
        for row, number in zip(rest, numbers.tolist(), strict=True):
            times = past(number)
            rate = turning(self.unloaded, times, self.delta[times], self.step)
            row += self.inertia[..., :-1] @ rate
        return rest

    def next_delta(self, number: int) -> FloatArray:
        """Rotations (slice,) rad after time `number`, up to which the motion is known.

        The contact is that of the next time.
        """
        weights = _MEAN if self.first_order else _PARABOLA
        numbers = np.maximum(number - np.arange(len(weights)), 0)
        loads = np.tensordot(weights, self._rest(numbers), 1)
        loads += self.contact[number + 1] + self._of_pressure(np.array([number + 1]))[0]
        times = past(number + 1)
        pressure, earlier = float(self.pressure[number + 1]), self.delta[times[1:]]
        return advance(
            self.chain, self.unloaded, times, pressure, self.step, self._around, loads, earlier
        )

    def alternates(self, number: int) -> bool:
        """Whether the rest of the loads changes its sign from step to step, and grows."""
        if number < _SIGNS + 4:
            return False
        numbers = np.arange(number - _SIGNS - 1, number + 1)
        arm = self.chain.arc[self.chain.joints[:-1]]
        bent = np.diff(self._rest(numbers)[..., 1] @ arm, 2)
        half = len(bent) // 2
        until, since = np.abs(bent[:half]).max(), np.abs(bent[half:]).max()
        most = np.abs(self.loads[: number + 1, :, 1] @ arm).max()
        return bool((bent[1:] * bent[:-1] < 0).all() and since > max(until, _LARGE * most))

    def check(self) -> Check:
        """What the loads make of the whole motion; the modelled inertia leaves no trace in it."""
        chain, pressure, delta = self.chain, self.pressure, self.delta
        numbers = np.arange(len(delta))
        rest = self._rest(numbers) + self._of_pressure(numbers) + self.contact
        after = motion(chain, pressure, self.step, self._around, rest, delta[0])
        change = chain.profile(pressure, after) - chain.profile(pressure, delta)
        # an impact takes energy within a step, in which it is not resolved
        touched = np.flatnonzero(self.contact.any(axis=(1, 2)))
        free = slice(0, touched[0] if len(touched) else None)
        parts = energies(
            chain, pressure[free], delta[free], self.step, self.water, self.loads[free]
        )
        bent = np.diff(delta, axis=1, prepend=0.0) / chain.springs
        laws = [chain.law_at(p) for p in pressure]
        share = max(law.share(law.moment(b)) for law, b in zip(laws, bent, strict=True))
        return Check(float(np.hypot(*change[:, -1].T).max()), open_share(parts), share)
