"""The chain under load, at rest and in motion: implicit in time, by Newton's method.

Accelerations are Houbolt's, from places at four times. The pressure prescribes the motion without
load and moves the joints itself, so that a method that needs places alone needs no mass matrix. It
damps the chain's highest modes at once, and the first mode at 1 ms by less than 1e-4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fileio.errors import StageError
from fileio.formats.bending_states import FloatArray
from pipeline.structure.chain import Chain, ComplexArray, Placed, joint_moments, placed
from pipeline.structure.elastic_law import ElasticLaw, law_at

STEP = 1e-3  # s, of the finger's own motion
INERT = ("rubber", "gap", "middle")  # what has velocity or acceleration
_ITERATIONS = 40
_TOLERANCE = 1e-10  # rad, of the last correction
_LARGEST_CORRECTION = 0.2  # rad
_NUDGE = 1e-6  # rad, of the differences that give the derivative
# Weights of the places now and before
_ACCELERATION = np.array([2.0, -5.0, 4.0, -1.0])  # Houbolt's, over the step squared
_VELOCITY = np.array([11.0, -18.0, 9.0, -2.0]) / 6  # over the step


@dataclass(frozen=True)
class Surroundings:
    """Gravity in the actuator's frame, the fluid (kg/m³; 0: none), modelled water and damping (s).

    `added_mass` and `drag` are coefficients of a water that `loads` then must not hold.
    """

    gravity: complex = 0.0
    fluid: float = 0.0
    added_mass: float = 0.0
    drag: float = 0.0
    damping: float = 0.0


@dataclass(frozen=True)
class Rates:
    """Velocity of the slices' middles, and accelerations (…, slice) of what has mass."""

    velocity: ComplexArray
    rubber: ComplexArray
    gap: ComplexArray
    middle: ComplexArray


def modelled_water(
    chain: Chain,
    around: Surroundings,
    heading: ComplexArray,
    velocity: ComplexArray,
    acceleration: ComplexArray,
) -> ComplexArray:
    """Force (…, slice) N of the modelled water across each slice, by the rates of its middle."""
    across = 1j * heading
    speed, rate = ((np.conj(across) * v).real for v in (velocity, acceleration))
    inertia = around.added_mass * np.pi / 4 * chain.width**2 * rate
    drag = around.drag * chain.width / 2 * np.abs(speed) * speed
    return -around.fluid * chain.lengths * (inertia + drag) * across


def forces(
    chain: Chain,
    around: Surroundings,
    at: Placed,
    rates: Rates,
    air: FloatArray,
    loads: FloatArray,
) -> list[tuple[ComplexArray, ComplexArray]]:
    """Forces on the slices (place, force), N: of rubber, gaps' water, air, and at the middle.

    `air`: section (…, 1) m² of the chambers; `loads` (…, slice, 3): N along and across each slice,
    and N m.
    """
    law, lengths = chain.law, chain.lengths
    mass, gravity, fluid = law.rubber_mass * lengths, around.gravity, around.fluid
    middle = (loads[..., 0] + 1j * loads[..., 1]) * at.heading
    middle = middle + modelled_water(chain, around, at.heading, rates.velocity, rates.middle)
    weight = mass * (gravity - rates.rubber) - fluid * law.rubber_section * lengths * gravity
    return [
        (at.rubber, weight),
        (at.gap, -fluid * chain.gap_section * lengths * rates.gap),
        (at.air, -fluid * air * lengths * gravity + 0 * at.air),
        (at.middle, middle),
    ]


def at_standstill(at: Placed) -> Rates:
    """No velocity and no acceleration."""
    return Rates(*[0 * at.middle] * 4)


def _newton(
    residual: Callable[[FloatArray], FloatArray], delta: FloatArray, where: str
) -> FloatArray:
    """The root of `residual` (batch, n) → (batch, n), from `delta` (n,); StageError."""
    count = len(delta)
    nudges = np.concatenate([np.zeros((1, count)), _NUDGE * np.eye(count)])
    for iteration in range(_ITERATIONS):
        if iteration % 4 == 0:
            values = residual(delta + nudges)
            derivative = (values[1:] - values[0]).T / _NUDGE
        else:
            values = residual(delta[None])
        step = np.linalg.solve(derivative, -values[0])
        size = float(np.abs(step).max())
        if not np.isfinite(size):
            break
        delta = delta + step * min(1.0, _LARGEST_CORRECTION / max(size, 1e-30))
        if size < _TOLERANCE:
            return delta
    raise StageError(
        f"the chain finds no equilibrium {where}: its loads are too large, or its time step is too"
        " long; check the motion and the time step"
    )


def at_rest(
    chain: Chain, pressure: float, around: Surroundings, loads: FloatArray, parts: int = 1
) -> FloatArray:
    """Rotations (slice,) rad in equilibrium at `pressure` (Pa) under `loads` (slice, 3).

    Gravity and loads are put on in so many `parts`.
    """
    unloaded = chain.unloaded(np.array([pressure]))
    law = law_at(chain.law, chain.pressure, pressure)
    air = chain.air_section(np.array([pressure]))
    delta = np.zeros(chain.slices)
    for part in np.arange(1, parts + 1) / parts:
        share = Surroundings(part * around.gravity, around.fluid)

        def residual(turned, part=part, share=share):
            at = placed(unloaded, 0, turned)
            acting = forces(chain, share, at, at_standstill(at), air, part * loads)
            moment = joint_moments(at, acting, part * loads[:, 2])
            return law.moment(np.diff(turned, axis=-1, prepend=0.0) / chain.springs) - moment

        delta = _newton(residual, delta, f"at rest at {pressure / 1e3:.3g} kPa")
    return delta


def motion(
    chain: Chain,
    pressure: FloatArray,
    step: float,
    around: Surroundings,
    loads: FloatArray,
    start: FloatArray | None = None,
) -> FloatArray:
    """Rotations (time, slice) rad against the shape without load, `step` (s) apart, from rest.

    `pressure` (time,) Pa; `loads` (time, slice, 3): N along and across slices, and N m; `start`:
    rotations in place of the equilibrium at the first time. StageError where the moment leaves the
    law of bending.
    """
    unloaded, air = chain.unloaded(pressure), chain.air_section(pressure)
    delta = np.empty((len(pressure), chain.slices))
    delta[0] = at_rest(chain, float(pressure[0]), around, loads[0]) if start is None else start
    first = placed(unloaded, 0, delta[0])
    before = {name: np.repeat(getattr(first, name)[None], 3, axis=0) for name in INERT}
    bends = np.repeat(np.diff(delta[0], prepend=0.0)[None], 3, axis=0)
    stiffness = np.interp(pressure, chain.pressure, chain.law.stiffness)
    for m in range(1, len(pressure)):
        law = law_at(chain.law, chain.pressure, float(pressure[m]))

        def residual(
            turned: FloatArray,
            m: int = m,
            law: ElasticLaw = law,
            places: dict[str, ComplexArray] = before,
            bent_before: FloatArray = bends,
        ) -> FloatArray:
            at = placed(unloaded, m, turned)
            bent = np.diff(turned, axis=-1, prepend=0.0)
            second = {
                n: _difference(_ACCELERATION, getattr(at, n), places[n]) / step**2 for n in INERT
            }
            rates = Rates(_difference(_VELOCITY, at.middle, places["middle"]) / step, **second)
            acting = forces(chain, around, at, rates, air[m], loads[m])
            moment = joint_moments(at, acting, loads[m, :, 2])
            rate = _difference(_VELOCITY, bent, bent_before)
            slowed = around.damping * stiffness[m] * rate / step
            return law.moment(bent / chain.springs) + slowed / chain.springs - moment

        ahead = 2 * delta[m - 1] - delta[max(m - 2, 0)]
        delta[m] = _newton(residual, ahead, f"at {m * step:.4g} s")
        bent = np.diff(delta[m], prepend=0.0)
        if not law.within(law.moment(bent / chain.springs)):
            raise StageError(
                f"at {m * step:.4g} s the finger bears a moment beyond the table of states.h5"
                f" ({law.most[1]:.2g} N m): it bends too far to be computed;"
                " check the motion and the time step"
            )
        at = placed(unloaded, m, delta[m])
        before = {n: np.concatenate([getattr(at, n)[None], v[:2]]) for n, v in before.items()}
        bends = np.concatenate([bent[None], bends[:2]])
    return delta


def _difference(weights: FloatArray, now: Any, before: Any) -> Any:
    """Weighted sum of a value now and (3, …) before, the latest first."""
    return weights[0] * now + np.tensordot(weights[1:], before, 1)


def rates_of(at: Placed, step: float) -> Rates:
    """Rates of a motion (time, slice), by the differences of `motion`; from rest."""

    def over_time(weights, places):
        long = np.concatenate([np.repeat(places[:1], 3, axis=0), places])
        terms = [w * long[3 - k : len(long) - k] for k, w in enumerate(weights)]
        return np.asarray(np.sum(terms, axis=0), dtype=complex)

    second = {n: over_time(_ACCELERATION, getattr(at, n)) / step**2 for n in INERT}
    return Rates(over_time(_VELOCITY, at.middle) / step, **second)
