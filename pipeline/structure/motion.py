"""The chain under load, at rest and in motion: implicit in time, by Newton's method.

Accelerations are Houbolt's, from places at four times. The motion without load is prescribed by the pressure and moves the
joints itself, so that a method that needs places alone needs no mass matrix; and the chain's highest modes, far above what
a time step resolves, must die out, which they do at once (its damping of the first mode at 1 ms is below 1e-4).
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
ITERATIONS = 40
TOLERANCE = 1e-10  # rad, of the last correction
LARGEST_CORRECTION = 0.2  # rad
NUDGE = 1e-6  # rad, of the differences that give the derivative
ACCELERATION = np.array(
    [2.0, -5.0, 4.0, -1.0]
)  # Houbolt's, of the places now and before, over the step squared
VELOCITY = np.array([11.0, -18.0, 9.0, -2.0]) / 6  # over the step
INERT = ("rubber", "gap", "middle")  # what has velocity or acceleration


@dataclass(frozen=True)
class Surroundings:
    """What acts on the finger but for `loads`: gravity (actuator's frame), the fluid (kg/m³; 0: none), model terms, damping.

    `added_mass` and `drag` are coefficients of a water that the loads then must not hold; `damping` (s) is the rubber's.
    """

    gravity: complex = 0.0
    fluid: float = 0.0
    added_mass: float = 0.0
    drag: float = 0.0
    damping: float = 0.0


@dataclass(frozen=True)
class Rates:
    """Velocity of the slices' middles, and accelerations (…, slice) of what has mass; zero at rest."""

    velocity: ComplexArray
    rubber: ComplexArray
    gap: ComplexArray
    middle: ComplexArray


def modelled_water(chain: Chain, around: Surroundings, heading: ComplexArray, velocity: ComplexArray,
                   acceleration: ComplexArray) -> ComplexArray:  # fmt: skip
    """Force (…, slice) N of the modelled water across each slice, by the velocity and acceleration of its middle."""
    across = 1j * heading
    speed = (np.conj(across) * velocity).real
    rate = (np.conj(across) * acceleration).real
    inertia = around.added_mass * np.pi / 4 * chain.width**2 * rate
    drag = around.drag * chain.width / 2 * np.abs(speed) * speed
    return -around.fluid * chain.lengths * (inertia + drag) * across


def forces(chain: Chain, around: Surroundings, at: Placed, rates: Rates, air: FloatArray,
           loads: FloatArray) -> list[tuple[ComplexArray, ComplexArray]]:  # fmt: skip
    """Forces on the slices as (place, force), N: of rubber, of the gaps' water, of the air, and at the middle.

    `air`: section (…, 1) m² of the chambers; `loads` (…, slice, 3): N along and across each slice, and N m.
    """
    law, lengths = chain.law, chain.lengths
    mass, gravity, fluid = law.rubber_mass * lengths, around.gravity, around.fluid
    middle = (loads[..., 0] + 1j * loads[..., 1]) * at.heading
    middle = middle + modelled_water(chain, around, at.heading, rates.velocity, rates.middle)
    return [
        (
            at.rubber,
            mass * (gravity - rates.rubber) - fluid * law.rubber_section * lengths * gravity,
        ),
        (at.gap, -fluid * chain.gap_section * lengths * rates.gap),
        (at.air, -fluid * air * lengths * gravity + 0 * at.air),
        (at.middle, middle),
    ]


def at_standstill(at: Placed) -> Rates:
    """No velocity and no acceleration."""
    nothing = 0 * at.middle
    return Rates(nothing, nothing, nothing, nothing)


def _newton(
    residual: Callable[[FloatArray], FloatArray], delta: FloatArray, where: str
) -> FloatArray:
    """The root of `residual` (batch, n) → (batch, n), from `delta` (n,). StageError, naming `where`."""
    count = len(delta)
    nudges = np.concatenate([np.zeros((1, count)), NUDGE * np.eye(count)])
    derivative = None
    for iteration in range(ITERATIONS):
        if derivative is None or iteration % 4 == 0:
            values = residual(delta + nudges)
            derivative = (values[1:] - values[0]).T / NUDGE
            value = values[0]
        else:
            value = residual(delta[None])[0]
        step = np.linalg.solve(derivative, -value)
        size = float(np.abs(step).max())
        if not np.isfinite(size):
            break
        delta = delta + step * min(1.0, LARGEST_CORRECTION / max(size, 1e-30))
        if size < TOLERANCE:
            return delta
    raise StageError(
        f"the chain finds no equilibrium {where}: its loads are too large, or its time step is too long"
    )


def at_rest(
    chain: Chain, pressure: float, around: Surroundings, loads: FloatArray, parts: int = 1
) -> FloatArray:
    """Rotations (slice,) rad in equilibrium at `pressure` (Pa) under `loads` (slice, 3), put on in so many `parts`."""
    unloaded = chain.unloaded(np.array([pressure]))
    law = law_at(chain.law, chain.pressure, pressure)
    air = chain.air_section(np.array([pressure]))
    delta = np.zeros(chain.slices)
    for part in np.arange(1, parts + 1) / parts:

        def residual(turned: FloatArray, part: float = part) -> FloatArray:
            at = placed(unloaded, 0, turned)
            given = Surroundings(part * around.gravity, around.fluid)
            moment = joint_moments(
                at,
                forces(chain, given, at, at_standstill(at), air, part * loads),
                part * loads[:, 2],
            )
            return law.moment(np.diff(turned, axis=-1, prepend=0.0) / chain.springs) - moment

        delta = _newton(residual, delta, f"at rest at {pressure / 1e3:.3g} kPa")
    return delta


def motion(chain: Chain, pressure: FloatArray, step: float, around: Surroundings, loads: FloatArray,
           start: FloatArray | None = None) -> FloatArray:  # fmt: skip
    """Rotations (time, slice) rad against the shape without load, at even times `step` (s) apart, from rest.

    `pressure` (time,) Pa; `loads` (time, slice, 3): N along and across each slice, and N m; `start`: other rotations than
    those of equilibrium at the first time. StageError where the loads go beyond the law of bending.
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
            acting = forces(chain, around, at, _rates(at, places, step), air[m], loads[m])
            moment = joint_moments(at, acting, loads[m, :, 2])
            slowed = around.damping * stiffness[m] * _difference(VELOCITY, bent, bent_before) / step
            return law.moment(bent / chain.springs) + slowed / chain.springs - moment

        ahead = 2 * delta[m - 1] - delta[max(m - 2, 0)]
        delta[m] = _newton(residual, ahead, f"at {m * step:.4g} s")
        bent = np.diff(delta[m], prepend=0.0)
        if not law.within(law.moment(bent / chain.springs)):
            raise StageError(
                f"at {m * step:.4g} s the finger bears a moment beyond the table of states.h5 ({law.most[1]:.2g} N m): it bends"
                " too far to be computed; check the motion and the time step"
            )
        at = placed(unloaded, m, delta[m])
        before = {
            name: np.concatenate([getattr(at, name)[None], values[:2]])
            for name, values in before.items()
        }
        bends = np.concatenate([bent[None], bends[:2]])
    return delta


def _difference(weights: FloatArray, now: Any, before: Any) -> Any:
    return weights[0] * now + np.tensordot(weights[1:], before, 1)


def _rates(at: Placed, before: dict[str, ComplexArray], step: float) -> Rates:
    """Rates now, from places before (3, slice), the latest first."""
    second = {n: _difference(ACCELERATION, getattr(at, n), before[n]) / step**2 for n in INERT}
    return Rates(_difference(VELOCITY, at.middle, before["middle"]) / step, **second)


def rates_of(at: Placed, step: float) -> Rates:
    """Rates of a motion (time, slice) at even times, by the same differences as it is computed; from rest."""

    def over_time(weights: FloatArray, places: ComplexArray) -> ComplexArray:
        long = np.concatenate([np.repeat(places[:1], 3, axis=0), places])
        terms = [w * long[3 - k : len(long) - k] for k, w in enumerate(weights)]
        return np.asarray(np.sum(terms, axis=0), dtype=complex)

    second = {n: over_time(ACCELERATION, getattr(at, n)) / step**2 for n in INERT}
    return Rates(over_time(VELOCITY, at.middle) / step, **second)
