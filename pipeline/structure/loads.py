"""From the sampled surface of the finger to forces and moments on the slices of the chain."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from fileio.formats.bending_states import FloatArray
from pipeline.openfoam.surface_vtk import area_vectors, read_surface
from pipeline.structure.chain import Chain, ComplexArray, Placed


@dataclass(frozen=True)
class SurfaceForces:
    """Of the computed part, in the plane: centres (face, 2) m and velocities (face, 2) m/s of the faces, and the water's force (face, 2) N."""

    place: FloatArray
    velocity: FloatArray
    force: FloatArray


def surface_forces(path: Path, density: float, left_alone: bool = False) -> SurfaceForces:
    """Pressure and shear on a sampled surface; `left_alone`: of two fingers the left one."""
    surface = read_surface(path)
    pressure, shear, velocity = (
        np.asarray(surface.cell_data[name]) for name in ("p", "wallShearStress", "U")
    )
    # the normals point out of the water, into the finger; wallShearStress is that of the wall on the water
    area = area_vectors(surface)
    force = density * (pressure[:, None] * area - shear * np.linalg.norm(area, axis=1)[:, None])
    place = np.asarray(surface.cell_centers().points)
    kept = place[:, 0] < 0 if left_alone else slice(None)
    return SurfaceForces(place[kept, :2], velocity[kept, :2], force[kept, :2])


@dataclass(frozen=True)
class SliceLoads:
    """Forces and torques of all slices at one time, the clamped length first: N along and across each, and N m about its middle."""

    force: ComplexArray  # (slice + 1)
    torque: FloatArray  # (slice + 1)


def slice_loads(chain: Chain, at: Placed, profile: FloatArray, thickness: FloatArray, place: ComplexArray,
                force: ComplexArray) -> SliceLoads:  # fmt: skip
    """Each face's force goes to the slice whose middle line is nearest.

    The chain at one time: `at`, its `profile` (point, 2) and `thickness` (point,); `place` and `force` (face,) in the
    actuator's frame, from the root's ventral edge.
    """
    line = middle_line(profile, thickness)
    pieces = 0.5 * (line[1:] + line[:-1])
    slice_of_piece = np.searchsorted(
        chain.joints, np.arange(len(pieces)), side="right"
    )  # 0: clamped
    _, piece = cKDTree(np.column_stack([pieces.real, pieces.imag])).query(
        np.column_stack([place.real, place.imag])
    )
    owner = slice_of_piece[piece]
    middle = np.concatenate([[line[: chain.joints[0] + 1].mean()], at.middle])
    heading = np.concatenate([[1.0], at.heading])
    count = chain.slices + 1
    total = np.bincount(owner, force.real, count) + 1j * np.bincount(owner, force.imag, count)
    turning = np.asarray(
        np.bincount(owner, (np.conj(place - middle[owner]) * force).imag, count), dtype=float
    )
    return SliceLoads(total * np.conj(heading), turning)


def middle_line(profile: FloatArray, thickness: FloatArray) -> ComplexArray:
    """Half way between the ventral and the dorsal side (point,)."""
    points = profile[:, 0] + 1j * profile[:, 1]
    along = np.gradient(points)
    return np.asarray(points - 0.5j * thickness * along / np.abs(along), dtype=complex)
