"""Coupling of finger and water over whole runs: from a run's loads to the next motion.

The structure bears modelled water, and the difference of the computed loads from that model. The
model vanishes where the motion no longer changes; it stands in for the water's answer to a change.
This is an approximate Newton's method over the whole history: without it the iteration diverges,
as the water is as heavy as the finger.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from fileio.errors import StageError
from fileio.formats.bending_states import FloatArray
from pipeline.structure.chain import Chain, placed
from pipeline.structure.motion import Surroundings, modelled_water, motion, rates_of

_KNOT = 4e-3  # s between two shapes: keeps the outline to 5 µm
_FIRST_KNOTS = 1e-3  # s, until _EARLY: the first motion is the fastest change of shape
_EARLY = 0.02  # s


def loads_of_model(
    chain: Chain, pressure: FloatArray, delta: FloatArray, step: float, around: Surroundings
) -> FloatArray:
    """The modelled water's loads (time, slice, 3) on a motion, as `forces` takes them."""
    at = placed(chain.unloaded(pressure), slice(None), delta)
    rates = rates_of(at, step)
    force = modelled_water(chain, around, at.heading, rates.velocity, rates.middle)
    force = force * np.conj(at.heading)
    return np.stack([force.real, force.imag, np.zeros(force.shape)], axis=-1)


def loads_at(loads: Mapping[str, Any] | xr.Dataset, time: FloatArray) -> FloatArray:
    """Loads (time, slice, 3) of a loads.h5 on the free slices at other times; none at 0."""
    known, force, torque = (np.asarray(loads[name]) for name in ("time", "force", "torque"))
    values = np.concatenate([force, torque[..., None]], axis=-1)[:, 1:]
    values = np.concatenate([np.zeros((1, *values.shape[1:])), values])
    return np.asarray(CubicSpline(np.concatenate([[0.0], known]), values)(time))


def next_delta(
    chain: Chain,
    pressure: FloatArray,
    step: float,
    around: Surroundings,
    delta: FloatArray,
    computed: FloatArray,
) -> FloatArray:
    """Rotations (time, slice) after those of `delta`, whose run gave the `computed` loads."""
    rest = computed - loads_of_model(chain, pressure, delta, step, around)
    return motion(chain, pressure, step, around, rest)


def knots(end: float) -> FloatArray:
    """Times (s) of the shapes of a motion."""
    early = np.arange(0, min(_EARLY, end), _FIRST_KNOTS)
    return np.unique(np.concatenate([early, np.arange(_EARLY, end, _KNOT), [end]]))


def motion_values(
    chain: Chain,
    time: FloatArray,
    pressure: FloatArray,
    delta: FloatArray,
    before: FloatArray | None,
) -> dict[str, Any]:
    """Variables and attributes of elastic_motion.h5, with the change from `before`."""
    at = knots(float(time[-1]))
    at_pressure, at_delta = CubicSpline(time, pressure)(at), CubicSpline(time, delta)(at)
    profile = chain.profile(at_pressure, at_delta)
    tip, bend = np.inf, np.inf
    if before is not None:
        change = chain.profile(pressure, delta) - chain.profile(pressure, before)
        tip = float(np.hypot(*change[:, -1].T).max())
        bend = float(np.abs(delta[:, -1] - before[:, -1]).max())
    return {
        "time": time,
        "pressure": pressure,
        "delta": delta,
        "knot": at,
        "profile_x": profile[..., 0],
        "profile_y": profile[..., 1],
        "thickness": chain.thickness(at_pressure),
        "tip_change": tip,
        "bend_change": bend,
    }


def check_change(changes: list[float], tolerance: float, where: Path) -> bool:
    """Whether the last change (m) of the tip is within `tolerance`; StageError where they grow."""
    if len(changes) > 1 and changes[-1] > max(changes[-2], tolerance):
        raise StageError(
            f"{where}: the coupling diverges: the tip's motion changed by"
            f" {changes[-2] * 1e3:.2g} mm and then by {changes[-1] * 1e3:.2g} mm;"
            " raise structure.added_mass and structure.drag"
        )
    return changes[-1] <= tolerance
