"""The first free vibration of a chain, which says how strongly its rubber damps it.

The loss factor of a silicone hardly depends on the frequency: free decays of beams of Dragon Skin
10 at 3.3, 4.3 and 7.7 Hz have 0.10 to 0.15 (Dubied et al., arXiv 2201.12560; recordings in
github.com/srl-ethz/diffPD_sim2real). The viscosity of the rubber is that which gives a finger's
first vibration this loss. A standard linear solid of that loss would be 7 to 17 % stiffer in
motion than at rest. The beams' frequencies and their sag at rest agree within 2 to 8 %.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from pipeline.formats.bending_states import FloatArray
from pipeline.structure.chain import GAP, MIDDLE, RUBBER, Chain, placed
from pipeline.structure.motion import Surroundings

LOSS_BAND = (0.10, 0.15)  # of the recordings
_NUDGE = 1e-6  # rad


def inertia(chain: Chain, pressure: float, around: Surroundings) -> FloatArray:
    """Mass matrix (slice, slice) kg m² of small rotations about the shape at `pressure` (Pa)."""
    unloaded = chain.unloaded(np.array([pressure]))
    turns = np.concatenate([np.zeros((1, chain.slices)), _NUDGE * np.eye(chain.slices)])
    at = placed(unloaded, 0, turns)
    moved = (at.content[1:] - at.content[0]) / _NUDGE
    across = np.conj(1j * at.heading[0]) * moved[:, MIDDLE]
    fluid = around.fluid * chain.lengths
    added = around.added_mass * np.pi / 4 * chain.width**2 * fluid
    parts = (
        (moved[:, RUBBER], chain.law.rubber_mass * chain.lengths),
        (moved[:, GAP], chain.gap_section * fluid),
        (across.real, added),
    )
    return np.asarray(sum((mass * place @ np.conj(place).T).real for place, mass in parts))


def slowness(chain: Chain, pressure: float, around: Surroundings) -> float:
    """One over the first angular frequency (s) about the shape at `pressure` (Pa) in `around`.

    A viscous over elastic stress per rate of a loss factor times this gives the vibration that
    loss.
    """
    bends = np.eye(chain.slices) - np.eye(chain.slices, k=-1)
    spring = np.interp(pressure, chain.pressure, chain.law.stiffness) / chain.springs
    stiffness = bends.T @ (spring[:, None] * bends)
    last = chain.slices - 1
    slowest = eigh(
        inertia(chain, pressure, around), stiffness, eigvals_only=True, subset_by_index=[last, last]
    )
    return float(np.sqrt(max(slowest[0], 0.0)))
