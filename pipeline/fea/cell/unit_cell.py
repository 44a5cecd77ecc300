"""The unit cell in equilibrium: quadratic hexahedra with reduced integration, follower pressure, contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from pipeline.fea.cell import plane
from pipeline.fea.cell.elements import follower_pressure, solid_body, surface
from pipeline.fea.cell.grid import Grid, build
from pipeline.fea.settings import Actuator, UnitCellMesh

FloatArray = NDArray[np.float64]
CONTACT_STIFFNESS = 2e10  # Pa/m of penetration: 40 kPa of contact pressure sink in by 0.002 mm


class NotConverged(RuntimeError):
    """Newton's method did not reach equilibrium."""


@dataclass(frozen=True)
class State:
    """Unknowns at one pressure: displacements with the plane's points by their distance, then u and φ.

    `moment` (N m): about the ventral edge, on the whole width of the actuator, positive where it bends towards that side.
    """

    pressure: float
    unknowns: FloatArray
    moment: float = 0.0

    @property
    def plane_shift(self) -> float:
        return float(self.unknowns[-2])

    @property
    def plane_angle(self) -> float:
        return float(self.unknowns[-1])


class UnitCell:
    """Residual, stiffness and Newton's method of one unit cell. Lengths are in m, stresses in Pa."""

    def __init__(self, actuator: Actuator, counts: UnitCellMesh) -> None:
        self.grid: Grid = build(actuator, counts)
        mesh = self.grid.mesh
        self.points: FloatArray = mesh.points
        self.n = len(self.points)
        self.x_plane = actuator.pitch / 2
        self.bodies = []
        for material, cells in (
            (actuator.materials.lower, self.grid.lower),
            (actuator.materials.upper, ~self.grid.lower),
        ):
            self.bodies.append(solid_body(mesh, cells, material))
        self.pressure = follower_pressure(mesh, self.grid.cavity)
        self.joined = np.flatnonzero(self.grid.plane)
        self.walls = [
            self._wall(self.grid.outer_wall),
            self._wall(self.grid.cavity & ~self.grid.middle),
        ]
        self.free = self._free()

    def _wall(self, mask: NDArray[np.bool_]) -> tuple[NDArray[np.intp], FloatArray]:
        """Points of the faces whose corners are all in `mask` and that look along x, with their contact stiffness."""
        region = surface(self.grid.mesh, mask)
        normal = region.dA.sum(1)
        along_x = np.abs(normal[0]) > 0.5 * np.linalg.norm(normal, axis=0)
        # equal shares: the consistent ones of an 8-node face are negative at its corners
        share = np.linalg.norm(normal, axis=0)[along_x] / 8
        area = np.bincount(
            region.mesh.cells_faces[along_x].ravel(), np.repeat(share, 8), minlength=self.n
        )
        points = np.flatnonzero(area)
        return points, np.asarray(CONTACT_STIFFNESS * area[points], dtype=float)

    def _free(self) -> NDArray[np.intp]:
        held = np.zeros((self.n, 3), dtype=bool)
        held[self.grid.middle, 0] = True
        held[self.grid.symmetry, 2] = True
        held[self.grid.ventral[0], 1] = True
        held[self.grid.plane, 0] = True  # their x follows from the plane
        return np.append(np.flatnonzero(~held.ravel()), [3 * self.n, 3 * self.n + 1])

    def rest(self) -> State:
        unknowns = np.zeros(3 * self.n + 2)
        unknowns[3 * self.joined + 1] = self.points[self.joined, 1]
        return State(0.0, unknowns)

    def displacement(self, state: State) -> FloatArray:
        """Displacements (n, 3) in m."""
        values = state.unknowns[:-2].reshape(-1, 3).copy()
        u, phi = state.unknowns[-2:]
        x, y = plane.joined_points(values[self.joined, 1], u, phi, self.x_plane)
        values[self.joined, 0] = x - self.points[self.joined, 0]
        values[self.joined, 1] = y - self.points[self.joined, 1]
        return values

    def residual(self, state: State) -> tuple[FloatArray, sparse.csr_matrix]:
        """Out-of-balance force (3 n + 2) by the unknowns, and its derivative."""
        values = self.displacement(state)
        force = np.zeros(3 * self.n)
        stiffness = sparse.csr_matrix((3 * self.n, 3 * self.n))
        for body in self.bodies:
            body.field[0].values[:] = values
            force += body.assemble.vector(body.field).toarray()[:, 0]
            stiffness = stiffness + body.assemble.matrix(body.field)
        self.pressure.field[0].values[:] = values
        # the pressure presses outwards on the wetted faces, whose normals look into the cavity
        force += (
            self.pressure.assemble.vector(self.pressure.field, state.pressure).toarray()[:, 0] * -1
        )
        stiffness = stiffness - self.pressure.assemble.matrix(self.pressure.field, state.pressure)

        u, phi = state.unknowns[-2:]
        distance = state.unknowns[3 * self.joined + 1]
        tangent = plane.joined_tangent(self.joined, distance, phi, self.n)
        out = tangent.T @ force
        matrix = tangent.T @ stiffness @ tangent + plane.joined_curvature(
            self.joined, distance, phi, force
        )
        position = self.points + values
        for (points, k), (shift, turn, foot, sign) in zip(
            self.walls, ((u, phi, self.x_plane, 1), (0.0, 0.0, 0.0, -1)), strict=True
        ):
            x, y = position[points, 0], position[points, 1]
            push, addition = plane.contact(points, sign * x, y, k, shift, turn, foot, self.n)
            push[0 : 3 * self.n : 3] *= sign
            if sign < 0:  # the middle of the chamber is fixed: nothing of its own moves
                push[-2:] = 0
                addition = _only_x(addition, 3 * self.n)
            out = out + push
            matrix = matrix + addition
        out[-1] -= 0.5 * state.moment  # the cell is half the width
        return out, matrix.tocsr()

    def solve(
        self,
        state: State,
        pressure: float,
        moment: float = 0.0,
        *,
        iterations: int = 25,
        tolerance: float = 1e-9,
    ) -> State:
        """Equilibrium at `pressure` (Pa) under a moment (N m) from a neighbouring state; raises NotConverged.

        `tolerance` bounds the last Newton correction, in m and rad.
        """
        unknowns = state.unknowns.copy()
        for _ in range(iterations):
            force, matrix = self.residual(State(pressure, unknowns, moment))
            block = matrix[self.free][:, self.free].tocsc()
            with np.errstate(all="raise"):
                try:
                    step = splu(block).solve(-force[self.free])
                except (RuntimeError, FloatingPointError) as error:
                    raise NotConverged(str(error)) from error
            size = np.abs(step).max()
            if not np.isfinite(size) or size > 0.5:
                raise NotConverged(f"correction of {size:.3g} at {pressure / 1e3:.3g} kPa")
            unknowns[self.free] += step
            if size < tolerance:
                return State(pressure, unknowns, moment)
        raise NotConverged(
            f"no equilibrium at {pressure / 1e3:.3g} kPa after {iterations} iterations"
        )


def _only_x(matrix: sparse.coo_matrix, n: int) -> sparse.coo_matrix:
    keep = (matrix.row < n) & (matrix.col < n)
    return sparse.coo_matrix(
        (matrix.data[keep], (matrix.row[keep], matrix.col[keep])), shape=matrix.shape
    )
