"""The moment of a joint of the chain that is bent, at any pressure in the chambers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from pipeline.formats.bending_states import BendingLaw, BendingStates, FloatArray, States

# of the table's last interval, along its slope; in the shipped states three times the moment
_BEYOND = 4.0
_LARGEST_CHANGE = 1e3  # 1/m: as far as a constant stiffness holds


def law_at(law: BendingLaw, pressures: FloatArray, pressure: float) -> PchipInterpolator:
    """Moment (N m) by the change of curvature (1/m) at `pressure` (Pa), monotone.

    Linear between the states at `pressures` (state,); beyond the table along its last slopes.
    """
    curvature = np.array([np.interp(pressure, pressures, column) for column in law.curvature.T])
    change = curvature - np.interp(0.0, law.moment, curvature)
    return PchipInterpolator(_continued(change), _continued(law.moment))


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


def bending_law(
    states: States, stiffness: float | None, density: float | None = None, width: float = 0.0
) -> BendingLaw | None:
    """The law of the states, with EI = `stiffness` (N m²) where it is known; None if neither is.

    That of a solid finger where its `density` (kg/m³) is known, and its `width` (m).
    """
    if stiffness is not None and density is not None:
        rest = int(np.argmin(np.abs(states.pressure)))
        height = float(states.thickness[rest].mean())
        solid = constant_law(stiffness, 0.5 * height, len(states.pressure))
        section = height * width
        return replace(
            solid, rubber_mass=density * section, rubber_section=section,
            rubber_height=0.5 * height,
        )  # fmt: skip
    law = states.law if isinstance(states, BendingStates) else None
    if stiffness is None:
        return law
    constant = constant_law(stiffness, 0.0, len(states.pressure))
    if law is None:
        return constant
    same = {name: getattr(constant, name) for name in ("stiffness", "moment", "curvature")}
    return replace(law, **same)
