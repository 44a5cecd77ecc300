"""From forces on the finger's wall to forces and moments on the slices of the chain."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from fileio.formats.bending_states import FloatArray
from pipeline.structure.chain import Chain, ComplexArray, Placed


def middle_line(profile: FloatArray, thickness: FloatArray) -> ComplexArray:
    """Points half way up the finger."""
    points = profile[:, 0] + 1j * profile[:, 1]
    along = np.gradient(points)
    return np.asarray(points - 0.5j * thickness * along / np.abs(along))


def slice_loads(
    chain: Chain,
    at: Placed,
    profile: FloatArray,
    thickness: FloatArray,
    place: ComplexArray,
    force: ComplexArray,
) -> tuple[ComplexArray, FloatArray]:
    """Forces (slice + 1) N along and across each slice, and torques N m about its middle.

    The clamped length comes first; each face's force goes to the slice whose middle line is
    nearest. `profile` (point, 2) and `thickness` (point,) are those of the chain `at` one time;
    `place` and `force` (face,) are in the actuator's frame, from the root's ventral edge.
    """
    line = middle_line(profile, thickness)
    pieces = 0.5 * (line[1:] + line[:-1])
    nearest = cKDTree(np.column_stack([pieces.real, pieces.imag])).query(
        np.column_stack([place.real, place.imag])
    )[1]
    owner = np.searchsorted(chain.joints, nearest, side="right")
    middle = np.concatenate([[line[: chain.joints[0] + 1].mean()], at.middle])
    heading = np.concatenate([[1.0], at.heading])
    turning = (np.conj(place - middle[owner]) * force).imag
    x, y, torque = (
        np.bincount(owner, part, chain.slices + 1) for part in (force.real, force.imag, turning)
    )
    return (x + 1j * y) * np.conj(heading), np.asarray(torque, dtype=float)
