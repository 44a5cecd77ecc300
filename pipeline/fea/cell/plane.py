"""The rigid mid-gap plane: the points joined to it, and frictionless contact with it.

By mirror symmetry the plane half way between two chambers stays plane. It moves along x by u and
turns by φ, positive when the dorsal side opens. Both are unknowns, so that neither a net force nor
a moment acts on a cell. A wall that reaches the plane touches its mirror image, the next chamber.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from pipeline.formats.bending_states import FloatArray


def joined_tangent(
    points: NDArray[np.intp], distance: FloatArray, phi: float, n_points: int
) -> sparse.csr_matrix:
    """Derivative (3 n, 3 n + 2) of all displacements by the unknowns.

    The unknowns are the displacements, then u and φ. The y slot of a joined point holds its
    `distance` along the plane; its x slot is not used.
    """
    n = 3 * n_points
    c, s = np.cos(phi), np.sin(phi)
    free = np.ones(n)
    free[3 * points] = 0
    free[3 * points + 1] = c
    one = np.ones_like(points)
    rows = [np.arange(n), 3 * points, 3 * points, 3 * points, 3 * points + 1]
    columns = [np.arange(n), 3 * points + 1, n * one, (n + 1) * one, (n + 1) * one]
    values = [free, s * one, one, distance * c, -distance * s]
    return _matrix(values, rows, columns, (n, n + 2)).tocsr()


def _matrix(values: list, rows: list, columns: list, shape: tuple[int, int]) -> sparse.coo_matrix:
    entries, row, column = (np.concatenate(part) for part in (values, rows, columns))
    return sparse.coo_matrix((entries, (row, column)), shape=shape)


def joined_curvature(
    points: NDArray[np.intp], distance: FloatArray, phi: float, residual: FloatArray
) -> sparse.coo_matrix:
    """Σ residual · ∂²x/∂q²: what the plane's rotation adds to the stiffness, (3 n + 2, 3 n + 2)."""
    n = len(residual)
    fx, fy = residual[3 * points], residual[3 * points + 1]
    mixed = fx * np.cos(phi) - fy * np.sin(phi)
    turn = -np.sum(distance * (fx * np.sin(phi) + fy * np.cos(phi)))
    slots, last = 3 * points + 1, np.full(len(points), n + 1)
    rows, columns = [slots, last, [n + 1]], [last, slots, [n + 1]]
    return _matrix([mixed, mixed, [turn]], rows, columns, (n + 2, n + 2))


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
    """Force (3 n + 2) and stiffness of a penalty ½ k g² on points beyond the plane.

    `stiffness` (point) is k in N/m.
    """
    depth = -gap(x, y, u, phi, x_plane)
    active = depth > 0
    points, x, y, k, depth = points[active], x[active], y[active], stiffness[active], depth[active]
    n = 3 * n_points
    c, s = np.cos(phi), np.sin(phi)
    one = np.ones(len(points))
    slope = np.stack([c * one, -s * one, -c * one, -(x - x_plane - u) * s - y * c], -1)
    last = np.ones_like(points)
    slots = np.stack([3 * points, 3 * points + 1, n * last, (n + 1) * last], -1)
    push = (k * depth)[:, None].repeat(4, 1) * slope
    force = np.bincount(slots.ravel(), push.ravel(), minlength=n + 2)
    second = np.zeros((len(points), 4, 4))
    for i, value in enumerate((-s * one, -c * one, s * one, -depth)):
        second[:, i, 3] = second[:, 3, i] = value
    blocks = slope[:, :, None] * slope[:, None, :] + depth[:, None, None] * second
    rows = slots[:, :, None].repeat(4, 2)
    places = rows.ravel(), rows.transpose(0, 2, 1).ravel()
    matrix = sparse.coo_matrix(((k[:, None, None] * blocks).ravel(), places), shape=(n + 2, n + 2))
    return np.asarray(force, dtype=float), matrix
