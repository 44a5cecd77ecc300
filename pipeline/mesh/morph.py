"""Moving the planform: nodes of least symmetric Dirichlet energy for moved boundaries.

The energy grows without bound as a cell flattens, so that no cell can invert (Smith & Schaefer
2015; Rabinovich et al. 2017, SLIM). It is minimised by Newton's method; where its own step does not
descend, with the Hessian of each triangle made positive (analytic eigensystem of an isotropic 2-D
energy; Smith, de Goes & Kim 2019).
"""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from numpy import ndarray
from scipy.sparse.linalg import SuperLU, splu

from pipeline.geometry.quality import Quality
from pipeline.scene.sections import Mesh

_GRADIENT_TOLERANCE = 1e-7  # square root of the energy still to be gained, relative to the energy
_MAX_ITERATIONS = 60


class MorphError(ValueError):
    """No valid mesh of this connectivity was found for a boundary."""


def check_quality(quality: Quality, bend: float, mesh: Mesh, beyond: float = 0.0) -> None:
    """MorphError, naming the bend, where a shape breaks mesh.max_non_orthogonality_deg.

    `beyond`: what is allowed above that limit, deg.
    """
    worst = quality.max_non_orthogonality_deg
    # beyond a right angle a face does not separate the centres of its cells
    limit = min(mesh.max_non_orthogonality_deg + beyond, 90.0)
    if worst > limit or quality.min_area_ratio <= 0:
        raise MorphError(
            f"non-orthogonality reaches {worst:.1f}° at {np.degrees(bend):.1f}° of bend, more than"
            f" mesh.max_non_orthogonality_deg = {mesh.max_non_orthogonality_deg:g}"
            + (f" ({limit:g}° in a coupled run)" if beyond else "")
        )


def corner_triangles(triangles: ndarray, quads: ndarray) -> ndarray:
    """Triangles (n, 3) whose positive areas make triangles, and quads at each corner, valid."""
    corners = ([3, 0, 1], [0, 1, 2], [1, 2, 3], [2, 3, 0])
    return np.vstack([triangles, *(quads[:, three] for three in corners)])


class Morph:
    """Symmetric Dirichlet energy of a planar mesh relative to the shape it was built in."""

    def __init__(self, rest: ndarray, triangles: ndarray, fixed: ndarray) -> None:
        """`rest` (node, 2) m; `fixed` (node, 2) bool: coordinates that are prescribed.

        All triangles weigh the same: small cells are as stiff as large ones.
        """
        self.triangles = triangles
        a, b, c = rest[triangles].swapaxes(0, 1)
        edges = np.stack([b - a, c - a], axis=-1)
        if (_determinant(edges) <= 0).any():
            raise MorphError("the mesh is inverted as built")
        inverse = np.linalg.inv(edges)  # F = (edge vectors now) (edge vectors at rest)^-1
        # dF/dx as a (triangle, 3 corners, 2) gradient: F_ij = sum_a x_a,i g_a,j
        g12 = inverse.transpose(0, 2, 1)
        self.gradient = np.stack([-g12[..., 0] - g12[..., 1], g12[..., 0], g12[..., 1]], axis=1)
        self.free = ~fixed.ravel()
        self.size = rest.size
        dof = (2 * triangles[:, :, None] + np.arange(2)).reshape(len(triangles), 6)
        self._dof = dof
        # the Hessian's pattern: where each triangle's entries go, and which are free coordinates
        key = np.tile(dof, (1, 6)).ravel() * self.size + np.repeat(dof, 6, axis=1).ravel()
        key, self._place = np.unique(key, return_inverse=True)
        self._columns, self._rows = np.divmod(key, self.size)
        self._start = np.searchsorted(self._columns, np.arange(self.size + 1))
        self._of_free = self.free[self._rows] & self.free[self._columns]
        number = np.cumsum(self.free) - 1
        self._free_rows, columns = (number[k[self._of_free]] for k in (self._rows, self._columns))
        self._free_start = np.searchsorted(columns, np.arange(self.free.sum() + 1))

    def deformation(self, nodes: ndarray) -> ndarray:
        """Deformation gradient F (triangle, 2, 2)."""
        return np.matmul(nodes[self.triangles].transpose(0, 2, 1), self.gradient)

    def is_valid(self, nodes: ndarray) -> bool:
        """True where no triangle is flat or turned over."""
        return bool((_determinant(self.deformation(nodes)) > 0).all())

    def energy(self, nodes: ndarray) -> float:
        """Sum of ½(|F|² + |F⁻¹|²); infinite where a triangle is turned over."""
        deformation = self.deformation(nodes)
        det = _determinant(deformation)
        if (det <= 0).any():
            return float("inf")
        square = (deformation**2).sum((1, 2))
        return float((0.5 * square * (1 + 1 / det**2)).sum())

    def derivatives(self, nodes: ndarray, exact: bool = False) -> tuple[ndarray, sp.csc_matrix]:
        """Gradient (2·node,) and Hessian of the energy, `exact` or made positive semi-definite."""
        u, s, v = _svd(self.deformation(nodes))
        s1, s2 = s[:, 0], s[:, 1]
        first = s - 1 / s**3
        stress = np.matmul(u * first[:, None, :], v.transpose(0, 2, 1))
        force = np.matmul(self.gradient, stress.transpose(0, 2, 1))
        gradient = np.bincount(self._dof.ravel(), force.reshape(len(s), 6).ravel(), self.size)
        stretch = 1 + 3 / s**4
        product = (s1 * s2) ** 3
        twist = 1 - (s1**2 - s1 * s2 + s2**2) / product
        if not exact:
            twist = np.maximum(twist, 0)
        flip = 1 + (s1**2 + s1 * s2 + s2**2) / product
        value = np.column_stack([stretch, twist, flip])
        along = np.matmul(self.gradient, v)  # (triangle, corner, singular direction)
        pairs = [
            along[:, :, None, i] * u[:, None, :, j] for i, j in ((0, 0), (1, 1), (0, 1), (1, 0))
        ]
        one, other = pairs[2:]
        pairs[2:] = (one - other) / np.sqrt(2), (one + other) / np.sqrt(2)
        # dF of unit size in each eigenmode, as a change of the corners
        flat = np.stack(pairs, 1).reshape(len(s), 4, 6)
        local = np.matmul((flat * value[:, :, None]).transpose(0, 2, 1), flat)
        entries = np.bincount(self._place, local.ravel())
        return gradient, sp.csc_matrix((entries, self._rows, self._start), [self.size] * 2)

    def _factored(self, hessian: sp.csc_matrix) -> SuperLU:
        """Solves for the free coordinates x of H x = right, the prescribed ones being 0."""
        entries = hessian.data[self._of_free], self._free_rows, self._free_start
        symmetric = {"SymmetricMode": True}
        return splu(
            sp.csc_matrix(entries, [len(self._free_start) - 1] * 2),
            permc_spec="MMD_AT_PLUS_A",
            options=symmetric,
            diag_pivot_thresh=0.0,
        )

    def relax(self, nodes: ndarray) -> ndarray:
        """Nodes of least energy with the fixed coordinates as in `nodes`, which must be valid."""
        nodes, exact = nodes.copy(), True
        energy = self.energy(nodes)
        for _ in range(_MAX_ITERATIONS):
            gradient, hessian = self.derivatives(nodes, exact)
            step = np.zeros(self.size)
            step[self.free] = -self._factored(hessian).solve(gradient[self.free])
            slope = gradient @ step
            move = step.reshape(-1, 2)
            if 0 <= -slope < _GRADIENT_TOLERANCE**2 * max(energy, 1.0):
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
        self, nodes: ndarray, boundary: Callable[[float], ndarray], start: float, goal: float
    ) -> ndarray:
        """Carry a relaxed mesh from boundary(start) to boundary(goal), in steps that keep it valid.

        The fixed coordinates of `boundary(q)`, (node, 2), are used. Raises MorphError.
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

    def pursuit(self, near: ndarray) -> Callable[[ndarray, ndarray], ndarray]:
        """Carries nearly relaxed meshes close to `near` to boundaries that have moved a little.

        One Newton step with the Hessian of `near`; nodes and target (node, 2) as of `approach`.
        """
        _, hessian = self.derivatives(near, exact=True)
        factor = self._factored(hessian)

        def pursue(nodes: ndarray, target: ndarray) -> ndarray:
            trial = self._respond(nodes, target, self._slope(nodes), hessian, factor)
            return self.approach(nodes, target) if trial is None else trial

        return pursue

    def _slope(self, nodes: ndarray) -> ndarray:
        """Gradient (2·node,) of the energy."""
        f = self.deformation(nodes)
        det, square = _determinant(f)[:, None, None], (f**2).sum((1, 2), keepdims=True)
        cofactor = np.stack([f[:, 1, 1], -f[:, 1, 0], -f[:, 0, 1], f[:, 0, 0]], -1)
        stress = f * (1 + 1 / det**2) - square / det**3 * cofactor.reshape(f.shape)
        force = np.matmul(self.gradient, stress.transpose(0, 2, 1))
        return np.bincount(self._dof.ravel(), force.ravel(), self.size)

    def approach(self, nodes: ndarray, target: ndarray) -> ndarray:
        """Carry a relaxed mesh straight to the fixed coordinates of `target`. Raises MorphError."""
        return self.follow(nodes, lambda part: nodes + part * (target - nodes), 0.0, 1.0)

    def _predict(self, nodes: ndarray, target: ndarray) -> ndarray | None:
        """The linear response of the relaxed mesh to moved boundaries; None where it inverts."""
        _, hessian = self.derivatives(nodes, exact=True)
        return self._respond(nodes, target, np.zeros(self.size), hessian, self._factored(hessian))

    def _respond(
        self,
        nodes: ndarray,
        target: ndarray,
        gradient: ndarray,
        hessian: sp.csc_matrix,
        factor: SuperLU,
    ) -> ndarray | None:
        free, move = self.free, (target - nodes).ravel()
        move[free] = 0.0
        move[free] = -factor.solve((gradient + hessian @ move)[free])
        trial = nodes + move.reshape(-1, 2)
        shrink = _determinant(self.deformation(trial)) / _determinant(self.deformation(nodes))
        return trial if shrink.min() > 0.1 else None


def _determinant(f: ndarray) -> ndarray:
    return f[:, 0, 0] * f[:, 1, 1] - f[:, 0, 1] * f[:, 1, 0]


def _svd(f: ndarray) -> tuple[ndarray, ndarray, ndarray]:
    """SVD of 2x2 matrices with det F > 0: F = U diag(s) V^T, rotations, s1 >= s2 > 0."""
    a, b, c, d = f.reshape(-1, 4).T
    e, h, g, k = 0.5 * (a + d), 0.5 * (c - b), 0.5 * (a - d), 0.5 * (c + b)
    q, r = np.hypot(e, h), np.hypot(g, k)
    a1, a2 = np.arctan2(k, g), np.arctan2(h, e)
    left, right = 0.5 * (a2 + a1), 0.5 * (a2 - a1)

    def rotation(angle: ndarray) -> ndarray:
        c, s = np.cos(angle), np.sin(angle)
        return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)

    return rotation(left), np.column_stack([q + r, q - r]), rotation(-right)
