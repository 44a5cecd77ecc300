"""The chain under load, at rest and in motion: implicit in time, by Newton's method.

Accelerations are Houbolt's, from places at four times. The pressure prescribes the motion without
load and moves the joints itself, so that a method that needs places alone needs no mass matrix. It
damps the chain's highest modes at once, and the first mode at 1 ms by less than 1e-4. The water's
`inertia` takes the flow's own acceleration, so that it can stand for the flow's step by step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.formats.bending_states import FloatArray
from pipeline.structure.chain import (
    AIR,
    GAP,
    MIDDLE,
    RUBBER,
    Chain,
    ComplexArray,
    Placed,
    Unloaded,
    joint_moments,
    placed,
)
from piv.files.errors import StageError

STEP = 1e-3  # s, of the finger's own motion
LARGEST_SHARE = 2.0  # of the moments to which the bending was analysed
_ITERATIONS = 40
_TOLERANCE = 1e-10  # rad, of the last correction
_LARGEST_CORRECTION = 0.2  # rad
_NUDGE = 1e-6  # rad, of the differences that give the derivative
# Weights of the places now and before
_ACCELERATION = np.array([2.0, -5.0, 4.0, -1.0, 0.0])  # Houbolt's, over the step squared
_VELOCITY = np.array([11.0, -18.0, 9.0, -2.0, 0.0]) / 6  # over the step
# what the flow feels of a wall: the backward difference of second order, taken twice
_FELT = np.array([9.0, -24.0, 22.0, -8.0, 1.0]) / 4
EARLIER = 4  # times before one that its rates need


@dataclass(frozen=True)
class Surroundings:
    """Gravity in the actuator's frame, the fluid (kg/m³; 0: none), modelled water and damping.

    `damping`: the rubber's viscous stress by rate over its elastic stress by strain, s.

    `added_mass` and `drag` are coefficients of a water that `loads` then must not hold; so are
    `inertia` (slice, 3, slice): loads by the slices' angular accelerations, N s² and N m s².
    `stream`: velocity of the modelled water in the actuator's frame, m/s.
    """

    gravity: complex = 0.0
    fluid: float = 0.0
    added_mass: float = 0.0
    drag: float = 0.0
    damping: float = 0.0
    inertia: FloatArray | None = None
    stream: complex = 0.0


def forces(
    chain: Chain,
    around: Surroundings,
    at: Placed,
    velocity: ComplexArray,
    acceleration: ComplexArray,
    air: FloatArray,
    loads: FloatArray,
) -> ComplexArray:
    """Forces (…, 4, slice) N on the slices' content.

    `velocity` (…, slice) of their middles; `acceleration` (…, 4, slice) of their content; `air`:
    section (…, 1) m² of the chambers; `loads` (…, slice, 3): N along and across slices, and N m.
    """
    law, lengths = chain.law, chain.lengths
    mass, gravity, fluid = law.rubber_mass * lengths, around.gravity, around.fluid * lengths
    across = 1j * at.heading
    speed, rate = (
        (np.conj(across) * each).real
        for each in (velocity - around.stream, acceleration[..., MIDDLE, :])
    )
    water = around.added_mass * np.pi / 4 * chain.width**2 * rate
    water = water + around.drag * chain.width / 2 * np.abs(speed) * speed
    force = np.empty_like(at.content)
    force[..., RUBBER, :] = mass * (gravity - acceleration[..., RUBBER, :])
    force[..., RUBBER, :] -= fluid * law.rubber_section * gravity
    force[..., GAP, :] = -fluid * chain.gap_section * acceleration[..., GAP, :]
    force[..., AIR, :] = -fluid * air * gravity
    force[..., MIDDLE, :] = (loads[..., 0] + 1j * loads[..., 1]) * at.heading
    force[..., MIDDLE, :] -= fluid * water * across
    return force


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


def at_rest(chain: Chain, pressure: float, around: Surroundings, loads: FloatArray) -> FloatArray:
    """Rotations (slice,) rad in equilibrium at `pressure` (Pa) under `loads` (slice, 3)."""
    unloaded = chain.unloaded(np.array([pressure]))
    law = chain.law_at(pressure)
    air = chain.air_section(np.array([pressure]))

    def residual(turned: FloatArray) -> FloatArray:
        at = placed(unloaded, 0, turned)
        still = 0 * at.content
        acting = forces(chain, around, at, still[..., MIDDLE, :], still, air, loads)
        moment = joint_moments(at, acting, loads[:, 2])
        return law(np.diff(turned, axis=-1, prepend=0.0) / chain.springs) - moment

    return _newton(residual, np.zeros(chain.slices), f"at rest at {pressure / 1e3:.3g} kPa")


def advance(
    chain: Chain,
    unloaded: Unloaded,
    times: NDArray[np.intp],
    pressure: float,
    step: float,
    around: Surroundings,
    loads: FloatArray,
    before: FloatArray,
    most: float = LARGEST_SHARE,
) -> FloatArray:
    """Rotations (slice,) rad at the first of `times`, numbers in `unloaded`, latest first.

    `pressure` (Pa) then; `step` (s); `loads` (slice, 3) then: N along and across slices, and N m;
    `before` (EARLIER, slice): rotations at the other times. StageError where a moment is more
    than `most` times those of the table.
    """
    earlier = placed(unloaded, times[1:], before)
    bends = np.diff(before, axis=-1, prepend=0.0)
    law, air = chain.law_at(pressure), chain.air_section(pressure)
    damping = around.damping * np.interp(pressure, chain.pressure, chain.law.stiffness)
    if around.inertia is not None:
        still = np.concatenate([np.zeros((1, chain.slices)), before])
        loads = loads - around.inertia @ turning(unloaded, times, still, step)
    moved, sped = (
        np.tensordot(weights[1:], earlier.content, 1) for weights in (_VELOCITY, _ACCELERATION)
    )
    bent_before = np.tensordot(_VELOCITY[1:], bends, 1)

    def residual(turned: FloatArray) -> FloatArray:
        at = placed(unloaded, int(times[0]), turned)
        bent = np.diff(turned, axis=-1, prepend=0.0)
        velocity = (_VELOCITY[0] * at.content[..., MIDDLE, :] + moved[MIDDLE]) / step
        acceleration = (_ACCELERATION[0] * at.content + sped) / step**2
        carried = loads
        if around.inertia is not None:
            rate = _FELT[0] / step**2 * turned
            carried = loads - np.einsum("slj,...j->...sl", around.inertia, rate)
        acting = forces(chain, around, at, velocity, acceleration, air, carried)
        moment = joint_moments(at, acting, carried[..., 2])
        slowed = damping * (_VELOCITY[0] * bent + bent_before) / step
        return law(bent / chain.springs) + slowed / chain.springs - moment

    name = f"at {times[0] * step:.4g} s"
    delta = _newton(residual, 3 * before[0] - 3 * before[1] + before[2], name)
    if chain.share(law(np.diff(delta, prepend=0.0) / chain.springs)) > most:
        raise StageError(
            f"{name} the finger bears a moment far beyond the table of states.h5"
            f" ({chain.law.moment[-1]:.2g} N m): it bends too far to be computed; check the motion"
            " and the time step"
        )
    return delta


def motion(
    chain: Chain,
    pressure: FloatArray,
    step: float,
    around: Surroundings,
    loads: FloatArray,
    start: FloatArray | None = None,
    most: float = LARGEST_SHARE,
    streams: ComplexArray | None = None,
) -> FloatArray:
    """Rotations (time, slice) rad against the shape without load, `step` (s) apart, from rest.

    `pressure` (time,) Pa; `loads` (time, slice, 3): N along and across slices, and N m; `start`:
    rotations in place of the equilibrium at the first time; `streams` (time,): as Surroundings',
    in its place. StageError as of `advance`.
    """
    unloaded = chain.unloaded(pressure)
    delta = np.empty((len(pressure), chain.slices))
    delta[0] = at_rest(chain, float(pressure[0]), around, loads[0]) if start is None else start
    for m in range(1, len(pressure)):
        times = past(m)
        if streams is not None:
            around = replace(around, stream=complex(streams[m]))
        delta[m] = advance(
            chain, unloaded, times, float(pressure[m]), step, around, loads[m], delta[times[1:]],
            most,
        )  # fmt: skip
    return delta


def past(number: int) -> NDArray[np.intp]:
    """Return the numbers of a time and of those before it that its rates need, latest first."""
    return np.maximum(number - np.arange(EARLIER + 1), 0)


def turning(
    unloaded: Unloaded, times: NDArray[np.intp], delta: FloatArray, step: float
) -> FloatArray:
    """Angular acceleration (slice,) of the slices as the flow feels it, rad/s².

    `times` and `delta` (EARLIER + 1, slice): latest first.
    """
    angle = np.unwrap(np.angle(unloaded.heading[times]), axis=0) + delta
    return felt(angle, step)


def felt(values: FloatArray, step: float) -> FloatArray:
    """Second derivative of values (EARLIER + 1, …), the latest first, as the flow feels it."""
    return np.asarray(_FELT @ values / step**2)


def rates_of(content: ComplexArray, step: float) -> tuple[ComplexArray, ComplexArray]:
    """Velocity and acceleration of places (time, …), by the differences of `motion`; from rest."""
    long = np.concatenate([np.repeat(content[:1], EARLIER, axis=0), content])

    def over_time(weights: FloatArray) -> ComplexArray:
        terms = [w * long[EARLIER - k : len(long) - k] for k, w in enumerate(weights)]
        return np.asarray(np.sum(terms, axis=0), dtype=complex)

    return over_time(_VELOCITY) / step, over_time(_ACCELERATION) / step**2
