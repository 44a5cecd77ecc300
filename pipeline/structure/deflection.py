"""The check of a prescribed motion: the deflection that the computed loads would cause at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fileio.formats.bending_states import FloatArray
from pipeline.structure.chain import Chain, Placed, joint_moments, placed
from pipeline.structure.elastic_law import law_at
from pipeline.structure.motion import INERT, Rates, Surroundings, forces

_STEP = 5e-4  # s, of the differences that give the accelerations of a prescribed motion


def prescribed(
    chain: Chain, pressure: Callable[[FloatArray], FloatArray], time: FloatArray
) -> tuple[Placed, Rates]:
    """The chain without elastic rotations, and its rates, at `time` (time,) s; `pressure`: Pa."""
    still = np.zeros((len(time), chain.slices))
    before, now, after = (
        placed(chain.unloaded(pressure(time + k * _STEP)), slice(None), still) for k in (-1, 0, 1)
    )
    second = {
        name: (getattr(after, name) - 2 * getattr(now, name) + getattr(before, name)) / _STEP**2
        for name in INERT
    }
    return now, Rates((after.middle - before.middle) / (2 * _STEP), **second)


def deflections(
    chain: Chain,
    pressure: FloatArray,
    at: Placed,
    rates: Rates,
    around: Surroundings,
    loads: FloatArray,
) -> FloatArray:
    """Turn (time,) rad of the tip by `loads` (time, slice, 3), weight, buoyancy and inertia.

    Of first order: each joint turns under the moment of all that acts beyond it in the prescribed
    shape, without the loads that the deflection itself would cause or relieve.
    """
    acting = forces(chain, around, at, rates, chain.air_section(pressure)[:, None], loads)
    moments = joint_moments(at, acting, loads[..., 2])
    changes = [
        law_at(chain.law, chain.pressure, p).change(moment)
        for p, moment in zip(pressure, moments, strict=True)
    ]
    return np.asarray(np.array(changes) @ chain.springs)
