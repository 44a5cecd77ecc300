"""Moving the planform: nodes that minimise the symmetric Dirichlet energy for given boundary positions.

The energy grows without bound as a cell flattens, so that no cell can invert (Smith & Schaefer 2015; Rabinovich et al. 2017, SLIM).
It is minimised by Newton's method; where its own step does not descend, with the Hessian of each triangle made positive
(analytic eigensystem of an isotropic 2-D energy; Smith, de Goes & Kim 2019).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

GRADIENT_TOLERANCE = 1e-7  # square root of the energy still to be gained, relative to the energy
MAX_ITERATIONS = 60


class MorphError(ValueError):
    """The boundary asks for a shape that no valid mesh of this connectivity was found for."""


def corner_triangles(triangles: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Triangles (n, 3) whose positive areas make triangles and quads valid: quads by their four corners."""
    q = quads
    corners = [q[:, [3, 0, 1]], q[:, [0, 1, 2]], q[:, [1, 2, 3]], q[:, [2, 3, 0]]]
    return np.vstack([triangles, *corners])


class Morph:
    """Symmetric Dirichlet energy of a planar mesh relative to the shape it was built in."""

    def __init__(
        self, rest: np.ndarray, triangles: np.ndarray, fixed: np.ndarray, weight_power: float = 1.0
    ) -> None:
        """`rest` (node, 2) m; `fixed` (node, 2) bool: coordinates that are prescribed.

        Each triangle weighs area^(1 - weight_power): with 1 small cells are as stiff as large ones.
        """
        self.triangles = triangles
        edges = _edges(rest, triangles)
        area = 0.5 * (edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
        if (area <= 0).any():
            raise MorphError("the mesh is inverted as built")
        inverse = np.linalg.inv(edges)  # F = (edge vectors now) (edge vectors at rest)^-1
        scale = area ** (1 - weight_power)
        self.weight = scale / scale.mean()
        # dF/dx as a (triangle, 3 corners, 2) gradient: F_ij = sum_a x_a,i g_a,j
        g12 = inverse.transpose(0, 2, 1)
        self.gradient = np.stack([-g12[..., 0] - g12[..., 1], g12[..., 0], g12[..., 1]], axis=1)
        self.free = ~fixed.ravel()
        self.size = rest.size
        dof = (2 * triangles[:, :, None] + np.arange(2)).reshape(len(triangles), 6)
        self._dof = dof
        # the Hessian's pattern is always the same: where each triangle's entries go, and which are of free coordinates
        key = np.tile(dof, (1, 6)).ravel() * self.size + np.repeat(dof, 6, axis=1).ravel()
        key, self._place = np.unique(key, return_inverse=True)
        self._columns, self._rows = np.divmod(key, self.size)
        self._start = np.searchsorted(self._columns, np.arange(self.size + 1))
        self._of_free = self.free[self._rows] & self.free[self._columns]
        number = np.cumsum(self.free) - 1
        self._free_rows, columns = (number[k[self._of_free]] for k in (self._rows, self._columns))
        self._free_start = np.searchsorted(columns, np.arange(self.free.sum() + 1))
        self.length = float(np.sqrt(np.median(area)))

    def deformation(self, nodes: np.ndarray) -> np.ndarray:
        """Deformation gradient F (triangle, 2, 2)."""
        return np.matmul(nodes[self.triangles].transpose(0, 2, 1), self.gradient)

    def is_valid(self, nodes: np.ndarray) -> bool:
        """True where no triangle is flat or turned over."""
        return bool((_determinant(self.deformation(nodes)) > 0).all())

    def energy(self, nodes: np.ndarray) -> float:
        """Weighted sum of ½(|F|² + |F⁻¹|²); infinite where a triangle is turned over."""
        deformation = self.deformation(nodes)
        det = _determinant(deformation)
        if (det <= 0).any():
            return float("inf")
        square = (deformation**2).sum((1, 2))
        return float((self.weight * 0.5 * square * (1 + 1 / det**2)).sum())

    def derivatives(
        self, nodes: np.ndarray, exact: bool = False
    ) -> tuple[np.ndarray, sp.csc_matrix]:
        """Gradient (2·node,) and Hessian of the energy: the `exact` one, or made positive semi-definite."""
        u, s, v = _svd(self.deformation(nodes))
        s1, s2 = s[:, 0], s[:, 1]
        first = s - 1 / s**3
        stress = np.matmul(u * (self.weight[:, None] * first)[:, None, :], v.transpose(0, 2, 1))
        force = np.matmul(self.gradient, stress.transpose(0, 2, 1))
        gradient = np.bincount(self._dof.ravel(), force.reshape(len(s), 6).ravel(), self.size)
        stretch = 1 + 3 / s**4
        product = (s1 * s2) ** 3
        twist = 1 - (s1**2 - s1 * s2 + s2**2) / product
        if not exact:
            twist = np.maximum(twist, 0)
        flip = 1 + (s1**2 + s1 * s2 + s2**2) / product
        value = self.weight[:, None] * np.column_stack([stretch[:, 0], stretch[:, 1], twist, flip])
        along = np.matmul(self.gradient, v)  # (triangle, corner, singular direction)
        mode = np.empty(
            (len(s), 4, 3, 2)
        )  # dF of unit size in each eigenmode, as a change of the corners
        mode[:, 0], mode[:, 1] = (along[:, :, None, k] * u[:, None, :, k] for k in (0, 1))
        one, other = (
            along[:, :, None, 0] * u[:, None, :, 1],
            along[:, :, None, 1] * u[:, None, :, 0],
        )
        mode[:, 2], mode[:, 3] = (one - other) / np.sqrt(2), (one + other) / np.sqrt(2)
        flat = mode.reshape(len(s), 4, 6)
        local = np.matmul((flat * value[:, :, None]).transpose(0, 2, 1), flat)
        entries = np.bincount(self._place, local.ravel())
        return gradient, sp.csc_matrix(
            (entries, self._rows, self._start), shape=(self.size, self.size)
        )

    def _solve(self, hessian: sp.csc_matrix, right: np.ndarray) -> np.ndarray:
        """Free coordinates x of H x = right, the prescribed ones being 0."""
        count = len(self._free_start) - 1
        matrix = sp.csc_matrix(
            (hessian.data[self._of_free], self._free_rows, self._free_start), shape=(count, count)
        )
        return splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            options={"SymmetricMode": True},
            diag_pivot_thresh=0.0,
        ).solve(right)

    def relax(self, nodes: np.ndarray) -> np.ndarray:
        """Nodes of least energy with the fixed coordinates as in `nodes`, which must be valid."""
        nodes, exact = nodes.copy(), True
        energy = self.energy(nodes)
        for _ in range(MAX_ITERATIONS):
            gradient, hessian = self.derivatives(nodes, exact)
            step = np.zeros(self.size)
            step[self.free] = -self._solve(hessian, gradient[self.free])
            slope = gradient @ step
            move = step.reshape(-1, 2)
            if 0 <= -slope < GRADIENT_TOLERANCE**2 * max(energy, 1.0):
                return nodes + move  # Newton's last step squares the error that is left
            if exact and not self.energy(nodes + move) <= energy + 1e-4 * slope < energy:
                exact = False  # too far from the minimum for Newton's own step
                continue
            scale = 1.0
            while (trial := self.energy(nodes + scale * move)) > energy + 1e-4 * scale * slope:
                scale *= 0.5
                if scale < 1e-8:
                    return nodes  # rounding: no lower energy along a descent direction
            nodes, energy, exact = nodes + scale * move, trial, True
        return nodes

    def follow(
        self, nodes: np.ndarray, boundary: Callable[[float], np.ndarray], start: float, goal: float
    ) -> np.ndarray:
        """Carry a relaxed mesh from boundary(start) to boundary(goal), in as many steps as validity needs.

        `boundary(q)` returns (node, 2) positions of which the fixed coordinates are used. Raises MorphError.
        """
        at, step = start, goal - start
        while abs(goal - at) > 1e-12 * max(abs(goal), abs(start), 1e-30):
            step = goal - at if abs(step) > abs(goal - at) else step
            trial = self._predict(nodes, boundary(at + step))
            if trial is None:
                step *= 0.5
                if abs(step) < 1e-3 * abs(goal - start):
                    raise MorphError("the mesh can follow no further")
                continue
            nodes, at = self.relax(trial), at + step
        return nodes

    def _predict(self, nodes: np.ndarray, target: np.ndarray) -> np.ndarray | None:
        """First guess for moved boundaries: the linear response of the relaxed mesh; None where it inverts."""
        _, hessian = self.derivatives(nodes, exact=True)
        free, move = self.free, (target - nodes).ravel()
        move[free] = 0.0
        move[free] = -self._solve(hessian, (hessian @ move)[free])
        trial = nodes + move.reshape(-1, 2)
        shrink = _determinant(self.deformation(trial)) / _determinant(self.deformation(nodes))
        return trial if shrink.min() > 0.1 else None


def _edges(nodes: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (nodes[triangles[:, k]] for k in range(3))
    return np.stack([b - a, c - a], axis=-1)


def _determinant(f: np.ndarray) -> np.ndarray:
    return f[:, 0, 0] * f[:, 1, 1] - f[:, 0, 1] * f[:, 1, 0]


def _svd(f: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation-variant SVD of 2x2 matrices in closed form: F = U diag(s) V^T with s1 >= s2 > 0 for det F > 0."""
    e, h = 0.5 * (f[:, 0, 0] + f[:, 1, 1]), 0.5 * (f[:, 1, 0] - f[:, 0, 1])
    g, k = 0.5 * (f[:, 0, 0] - f[:, 1, 1]), 0.5 * (f[:, 1, 0] + f[:, 0, 1])
    q, r = np.hypot(e, h), np.hypot(g, k)
    a1, a2 = np.arctan2(k, g), np.arctan2(h, e)
    left, right = 0.5 * (a2 + a1), 0.5 * (a2 - a1)

    def rotation(angle: np.ndarray) -> np.ndarray:
        c, s = np.cos(angle), np.sin(angle)
        return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)

    return rotation(left), np.column_stack([q + r, q - r]), rotation(-right)
