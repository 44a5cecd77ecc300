"""The rigid mid-gap plane: kinematics of the points joined to it, and frictionless contact with it.

By mirror symmetry the plane half way between two chambers stays plane. It moves along x by u and turns by φ (positive
when the dorsal side opens); both are unknowns, so that neither a net force nor a moment acts on a cell. A wall that
reaches the plane touches its own mirror image, the neighbouring chamber.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

FloatArray = NDArray[np.float64]


def joined_points(
    distance: FloatArray, u: float, phi: float, x_plane: float
) -> tuple[FloatArray, FloatArray]:
    """Position (x, y) of points of the plane at `distance` from its foot (x_plane + u, 0)."""
    return x_plane + u + distance * np.sin(phi), distance * np.cos(phi)


def joined_tangent(
    points: NDArray[np.intp], distance: FloatArray, phi: float, n_points: int
) -> sparse.csr_matrix:
    """Derivative (3 n, 3 n + 2) of all displacements by the unknowns.

    The unknowns are the displacements, but that the y slot of a joined point holds its distance along the plane and
    its x slot is not used; u and φ come last.
    """
    n = 3 * n_points
    free = np.ones(n)
    free[3 * points] = 0
    free[3 * points + 1] = np.cos(phi)
    diagonal = sparse.coo_matrix((free, (np.arange(n), np.arange(n))), shape=(n, n + 2))
    rows = np.concatenate([3 * points, 3 * points, 3 * points, 3 * points + 1])
    columns = np.concatenate(
        [3 * points + 1, np.full(len(points), n), np.full(2 * len(points), n + 1)]
    )
    one = np.ones(len(points))
    values = np.concatenate(
        [np.sin(phi) * one, one, distance * np.cos(phi), -distance * np.sin(phi)]
    )
    return (diagonal + sparse.coo_matrix((values, (rows, columns)), shape=(n, n + 2))).tocsr()


def joined_curvature(
    points: NDArray[np.intp], distance: FloatArray, phi: float, residual: FloatArray
) -> sparse.coo_matrix:
    """Σ residual · ∂²x/∂q²: what the plane's rotation adds to the stiffness, (3 n + 2, 3 n + 2)."""
    n = len(residual)
    fx, fy = residual[3 * points], residual[3 * points + 1]
    mixed = fx * np.cos(phi) - fy * np.sin(phi)
    turn = -np.sum(distance * (fx * np.sin(phi) + fy * np.cos(phi)))
    slots = 3 * points + 1
    last = np.full(len(points), n + 1)
    rows = np.concatenate([slots, last, [n + 1]])
    columns = np.concatenate([last, slots, [n + 1]])
    return sparse.coo_matrix(
        (np.concatenate([mixed, mixed, [turn]]), (rows, columns)), shape=(n + 2, n + 2)
    )


def gap(x: FloatArray, y: FloatArray, u: float, phi: float, x_plane: float) -> FloatArray:
    """Distance (m) of points to the plane, positive where they do not touch it."""
    return -((x - x_plane - u) * np.cos(phi) - y * np.sin(phi))


def contact(
    points: NDArray[np.intp],
    x: FloatArray,
    y: FloatArray,
    stiffness: FloatArray,
    u: float,
    phi: float,
    x_plane: float,
    n_points: int,
) -> tuple[FloatArray, sparse.coo_matrix]:
    """Force (3 n + 2) and stiffness of a penalty ½ k g² on points beyond the plane; `stiffness` k in N/m per point."""
    depth = -gap(x, y, u, phi, x_plane)
    active = depth > 0
    points, x, y, k, depth = points[active], x[active], y[active], stiffness[active], depth[active]
    n = 3 * n_points
    c, s = np.cos(phi), np.sin(phi)
    one = np.ones(len(points))
    slope = np.stack([c * one, -s * one, -c * one, -(x - x_plane - u) * s - y * c], -1)
    slots = np.stack(
        [3 * points, 3 * points + 1, (n * one).astype(int), ((n + 1) * one).astype(int)], -1
    )
    force = np.bincount(
        slots.ravel(), (k * depth)[:, None].repeat(4, 1).ravel() * slope.ravel(), minlength=n + 2
    )
    second = np.zeros((len(points), 4, 4))
    for i, j, value in ((0, 3, -s * one), (1, 3, -c * one), (2, 3, s * one)):
        second[:, i, j] = second[:, j, i] = value
    second[:, 3, 3] = -depth
    blocks = k[:, None, None] * (
        slope[:, :, None] * slope[:, None, :] + depth[:, None, None] * second
    )
    rows = slots[:, :, None].repeat(4, 2)
    matrix = sparse.coo_matrix(
        (blocks.ravel(), (rows.ravel(), rows.transpose(0, 2, 1).ravel())), shape=(n + 2, n + 2)
    )
    return np.asarray(force, dtype=float), matrix
