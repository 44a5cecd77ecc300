"""The a-posteriori check of a prescribed motion: the deflection that the computed loads would cause at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fileio.formats.bending_states import FloatArray
from pipeline.structure.chain import Chain, Placed, joint_moments, placed
from pipeline.structure.elastic_law import law_at
from pipeline.structure.motion import Rates, Surroundings, forces

STEP = 5e-4  # s, of the differences that give the accelerations of a prescribed motion


def prescribed(
    chain: Chain, pressure: Callable[[FloatArray], FloatArray], time: FloatArray
) -> tuple[Placed, Rates]:
    """The chain without elastic rotations, and its rates, over `time` (time,) s; `pressure`: Pa at times."""
    still = np.zeros((len(time), chain.slices))
    before, now, after = (
        placed(chain.unloaded(pressure(time + k * STEP)), slice(None), still) for k in (-1, 0, 1)
    )

    def second(name: str) -> np.ndarray:
        return (getattr(after, name) - 2 * getattr(now, name) + getattr(before, name)) / STEP**2

    velocity = (after.middle - before.middle) / (2 * STEP)
    return now, Rates(velocity, second("rubber"), second("gap"), second("middle"))


def deflections(chain: Chain, pressure: FloatArray, at: Placed, rates: Rates, around: Surroundings, loads: FloatArray
                ) -> FloatArray:  # fmt: skip
    """Turn (time,) rad of the tip by `loads` (time, slice, 3), weight, buoyancy and inertia of a motion as it is prescribed.

    What the joints would turn by at once, each under the moment of all that acts beyond it in the prescribed shape: of first
    order in the deflection, and without the loads that the deflection itself would cause or relieve.
    """
    acting = forces(chain, around, at, rates, chain.air_section(pressure)[:, None], loads)
    moments = joint_moments(at, acting, loads[..., 2])
    laws = [law_at(chain.law, chain.pressure, float(p)) for p in pressure]
    changes = np.array([law.change(moment) for law, moment in zip(laws, moments, strict=True)])
    return np.asarray(changes @ chain.springs)
