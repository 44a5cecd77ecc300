"""Where the work of the chambers' pressure goes: into the rubber, into motion, into the water."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.formats.bending_states import FloatArray
from pipeline.structure.chain import GAP, MIDDLE, RUBBER, Chain, ComplexArray, placed
from pipeline.structure.motion import Surroundings, forces, rates_of

_REST = 1e-9  # J: bends a soft finger of 50 mm by 0.01 mm; less work is that of rounding


def energies(
    chain: Chain,
    pressure: FloatArray,
    delta: FloatArray,
    step: float,
    around: Surroundings,
    loads: FloatArray,
) -> dict[str, FloatArray]:
    """Work done since the start of a motion (time,) and stored energy, J; times `step` (s) apart.

    `pressure_work` is that on the motion at fixed elastic rotations; `water_work` that of `loads`
    (time, slice, 3) and modelled water; `weight_work` that of weight and buoyancy. Each is summed
    by itself: pressure, water and weight = elastic + kinetic + damping to the motion's accuracy.
    """
    count = len(pressure)
    unloaded = chain.unloaded(pressure)
    at = placed(unloaded, slice(None), delta)
    air = chain.air_section(pressure)[:, None]
    first, second = rates_of(at.content, step)
    acting = forces(chain, around, at, first[:, MIDDLE], second, air, loads)
    weight = forces(chain, around, at, 0 * first[:, MIDDLE], 0 * second, air, 0 * loads)
    velocity = np.gradient(at.content, step, axis=0)
    turning = np.gradient(np.unwrap(np.angle(at.heading), axis=0), step, axis=0)
    ahead, behind = (
        placed(unloaded, np.clip(np.arange(count) + k, 0, count - 1), delta) for k in (1, -1)
    )
    own = (ahead.content - behind.content) / (2 * step)
    own_turning = turning - np.gradient(delta, step, axis=0)

    def work(power: FloatArray) -> FloatArray:
        return np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * step])

    def power(force: ComplexArray, rates: ComplexArray) -> FloatArray:
        return (np.conj(force) * rates).real.reshape(count, -1).sum(-1)

    on_middle, torque = power(acting[:, MIDDLE], velocity[:, MIDDLE]), loads[..., 2]
    rate = np.gradient(np.diff(delta, axis=1, prepend=0.0), step, axis=0)
    stiffness = np.interp(pressure, chain.pressure, chain.law.stiffness)[:, None]
    masses = ((RUBBER, chain.law.rubber_mass), (GAP, around.fluid * chain.gap_section))
    kinetic = sum(
        0.5 * mass * (chain.lengths * np.abs(velocity[:, part]) ** 2).sum(-1)
        for part, mass in masses
    )
    return {
        "pressure_work": -work(power(acting, own) + (torque * own_turning).sum(-1)),
        "water_work": work(on_middle + (torque * turning).sum(-1)),
        "weight_work": work(power(weight, velocity)),
        "elastic_energy": work((chain.moments(pressure, delta) * rate).sum(-1)),
        "kinetic_energy": np.asarray(kinetic - kinetic[0]),
        "damping_loss": work((around.damping * stiffness / chain.springs * rate**2).sum(-1)),
    }


def open_share(parts: Mapping[str, Any], span: int | None = None) -> float:
    """Largest gap between work done and energy stored or lost, over the largest work.

    That of the pressure, or of a current's water, which moves a finger without pressure. `span`:
    time steps over which both count, as the gap of a flutter grows from period to period; None:
    the whole motion.
    """

    def within(value: FloatArray) -> FloatArray:
        return value if span is None else value - np.pad(value, (span, 0))[: len(value)]

    left = np.asarray(parts["pressure_work"]) + parts["water_work"] + parts["weight_work"]
    for name in ("elastic_energy", "kinetic_energy", "damping_loss"):
        left = left - np.asarray(parts[name])
    works = [within(np.asarray(parts[name])) for name in ("pressure_work", "water_work")]
    return float(np.abs(within(left)).max() / max(np.abs(works).max(), _REST))
