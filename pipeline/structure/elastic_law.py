"""How a joint of the chain answers a moment, at any pressure in the chambers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from fileio.formats.bending_states import BendingLaw, BendingStates, FloatArray, States

# of the table's last interval, along its slope; in the shipped states three times the moment
_BEYOND = 4.0
LARGEST_SHARE = 2.0  # of the table's moments, to which a motion may go on along that slope
_LARGEST_CHANGE = 1e3  # 1/m: as far as a constant stiffness holds


@dataclass(frozen=True)
class ElasticLaw:
    """Change of curvature (1/m) under a moment (N m) at one pressure, and back; monotone.

    `most`: the table's first and last moment (N m); the law goes on along its last slopes.
    """

    change: PchipInterpolator
    moment: PchipInterpolator
    most: tuple[float, float]

    def share(self, moment: FloatArray) -> float:
        """The largest of moments (N m) over that of the table."""
        return float(np.maximum(moment / self.most[0], moment / self.most[1]).max())


def law_at(law: BendingLaw, pressures: FloatArray, pressure: float) -> ElasticLaw:
    """The law at `pressure` (Pa), linear between those of the states at `pressures` (state,)."""
    curvature = np.array([np.interp(pressure, pressures, column) for column in law.curvature.T])
    change = _continued(curvature - np.interp(0.0, law.moment, curvature))
    moment = _continued(law.moment)
    most = float(law.moment[0]), float(law.moment[-1])
    return ElasticLaw(PchipInterpolator(moment, change), PchipInterpolator(change, moment), most)


def _continued(values: FloatArray) -> FloatArray:
    first, last = _BEYOND * (values[0] - values[1]), _BEYOND * (values[-1] - values[-2])
    return np.concatenate([[values[0] + first], values, [values[-1] + last]])


def constant_law(stiffness: float, neutral_axis: float, states: int) -> BendingLaw:
    """The law of a weightless finger with known EI (N m²) and height (m) of the neutral axis."""
    each = np.ones(states)
    change = np.array([-_LARGEST_CHANGE, 0.0, _LARGEST_CHANGE])
    return BendingLaw(
        stiffness=stiffness * each,
        neutral_axis=neutral_axis * each,
        moment=stiffness * change,
        curvature=np.outer(each, change),
        air_section=0 * each,
        air_height=0 * each,
        rubber_mass=0.0,
        rubber_section=0.0,
        rubber_height=0.0,
        clamped_length=0.0,
    )


def bending_law(states: States, stiffness: float | None) -> BendingLaw | None:
    """The law of the states, with EI = `stiffness` (N m²) where it is known; None if neither is."""
    law = states.law if isinstance(states, BendingStates) else None
    if stiffness is None:
        return law
    constant = constant_law(stiffness, 0.0, len(states.pressure))
    if law is None:
        return constant
    same = {name: getattr(constant, name) for name in ("stiffness", "moment", "curvature")}
    return replace(law, **same)
