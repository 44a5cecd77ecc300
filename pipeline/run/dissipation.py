"""Losses of the flow's energy by viscosity, convection scheme and pressure-velocity coupling.

They are the solver's own discrete terms times the velocity of the cell, less what moves to other
cells or through a wall, by face (docs/schemes.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fileio.formats.records import LOSSES
from pipeline.openfoam.polymesh_files import Faces

_UPWIND_SHARE = {"LUST": 0.25, "linearUpwind": 1.0}
_LIMIT = 0.5  # of the non-orthogonal correction: system/fvSchemes
_LEAST_COSINE = 0.05  # OpenFOAM's least distance of two cells along the face's normal


@dataclass(frozen=True)
class FaceGeometry:
    """Faces and cells of a mesh in one shape, m: area vectors and centres, centres and volumes.

    Faces of patches of no extent (2-D) have area vectors of zero.
    """

    faces: Faces
    area: np.ndarray
    centre: np.ndarray
    cell_centre: np.ndarray
    volume: np.ndarray

    @property
    def inner(self) -> int:
        """Number of inner faces."""
        return len(self.faces.neighbour)


def face_geometry(faces: Faces, points: np.ndarray, cell_centre: np.ndarray, volume: np.ndarray,
                  empty: tuple[str, ...]) -> FaceGeometry:  # fmt: skip
    """Geometry of plane faces with corners `points` (point, 3); patches `empty`: no extent."""
    corner = points[faces.corners]
    first, second = (
        np.cross(corner[:, k] - corner[:, 0], corner[:, k + 1] - corner[:, 0]) / 2 for k in (1, 2)
    )
    area = first + second
    size = np.linalg.norm(area, axis=1)[:, None]
    parts = [np.einsum("fi,fi->f", part, area)[:, None] / size**2 for part in (first, second)]
    middles = corner[:, [0, 1, 2]].mean(1), corner[:, [0, 2, 3]].mean(1)
    centre = sum(part * middle for part, middle in zip(parts, middles, strict=True))
    for name in empty:
        area[faces.patches[name]] = 0.0
    return FaceGeometry(faces, area, np.asarray(centre), cell_centre, volume)


def face_terms(
    mesh: FaceGeometry,
    velocity: np.ndarray,
    pressure: np.ndarray,
    on_boundary: np.ndarray,
    swept: np.ndarray,
    viscosity: np.ndarray,
    convection: str,
) -> dict[str, np.ndarray]:
    """Power over density that each of LOSSES takes at faces (face,), m⁵/s³.

    `velocity` (cell, 3) m/s; `pressure` (cell,) m²/s²; `on_boundary` (boundary face, 3) m/s;
    `swept` (face,) m³/s: flux of the mesh's own motion; `viscosity` (cell,) m²/s.
    """
    n, own, other = mesh.inner, mesh.faces.owner, mesh.faces.neighbour
    inside, outside = mesh.area[:n], mesh.area[n:]
    rim = own[n:]
    own = own[:n]
    across = mesh.cell_centre[other] - mesh.cell_centre[own]
    size = np.linalg.norm(inside, axis=1)
    normal = inside / size[:, None]
    to_own = _dot(normal, mesh.centre[:n] - mesh.cell_centre[own])
    share = to_own / _dot(normal, across)  # of the neighbour in a value at the face

    def at_faces(values: np.ndarray) -> np.ndarray:
        weight = share.reshape(-1, *[1] * (values.ndim - 1))
        return values[own] * (1 - weight) + values[other] * weight

    linear = at_faces(velocity)
    gradient = _gradient(mesh, linear, on_boundary)
    change = velocity[other] - velocity[own]
    flux = _dot(linear, inside) - swept[:n]

    # convection: the convected value less the mean of both sides, which would keep the energy
    upwind = np.where(flux > 0, own, other)
    ahead = mesh.centre[:n] - mesh.cell_centre[upwind]
    carried = velocity[upwind] + np.einsum("fi,fij->fj", ahead, gradient[upwind])
    part = _UPWIND_SHARE[convection]
    carried = part * carried + (1 - part) * linear
    mean = 0.5 * (velocity[own] + velocity[other])
    convected = -flux * _dot(carried - mean, change)

    # viscosity: with the limited correction of the normal gradient
    cosine = np.maximum(_dot(normal, across), _LEAST_COSINE * np.linalg.norm(across, axis=1))
    slope = change / cosine[:, None]
    skew = normal - across / cosine[:, None]
    correction = np.einsum("fi,fij->fj", skew, at_faces(gradient))
    scale = np.linalg.norm(slope, axis=1) / np.maximum(np.linalg.norm(correction, axis=1), 1e-30)
    correction *= np.minimum(1.0, _LIMIT / (1 - _LIMIT) * scale)[:, None]
    inner_viscous = at_faces(viscosity) * size * _dot(slope + correction, change)
    edge = np.linalg.norm(outside, axis=1)
    real = edge > 0
    away = _dot(outside, mesh.centre[n:] - mesh.cell_centre[rim]) / np.where(real, edge, 1.0)
    jump = on_boundary - velocity[rim]
    rim_viscous = np.where(
        real, viscosity[rim] * edge / np.where(real, away, 1.0) * _dot(jump, jump), 0.0
    )

    # pressure: work of its gradient on the cells' velocity, less that on the walls'
    coupled = -at_faces(pressure) * _dot(inside, change)
    rim_coupled = -pressure[rim] * _dot(outside, jump)

    taken = (inner_viscous, rim_viscous), (convected,), (coupled, rim_coupled)
    return {name: np.concatenate(parts) for name, parts in zip(LOSSES, taken, strict=True)}


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("fi,fi->f", a, b)


def _gradient(mesh: FaceGeometry, inner: np.ndarray, boundary: np.ndarray) -> np.ndarray:
    """Gradient (cell, direction, component) by Gauss's theorem from values on faces."""
    n, cells = mesh.inner, len(mesh.volume)
    gradient = np.empty((cells, 3, 3))
    for i in range(3):
        for j in range(3):
            through = mesh.area[:, i] * np.concatenate([inner[:, j], boundary[:, j]])
            total = np.bincount(mesh.faces.owner, through, cells)
            total -= np.bincount(mesh.faces.neighbour, through[:n], cells)
            gradient[:, i, j] = total / mesh.volume
    return gradient
