"""The unit cell in equilibrium: hexahedra, follower pressure and contact."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from pipeline.fea.cell import plane
from pipeline.fea.cell.elements import follower_pressure, solid_body, surface
from pipeline.fea.cell.grid import Grid, build
from pipeline.fea.settings import Actuator, UnitCellMesh
from pipeline.formats.bending_states import FloatArray

_CONTACT_STIFFNESS = 2e10  # Pa/m of penetration: 40 kPa of contact pressure sink in by 0.002 mm
_ITERATIONS = 25
_TOLERANCE = 1e-9  # m and rad: of the last Newton correction


class NotConverged(RuntimeError):
    """Newton's method did not reach equilibrium."""


@dataclass(frozen=True)
class State:
    """Unknowns at one pressure (Pa), as `plane.joined_tangent` orders them.

    `moment` (N m) acts on the whole width and bends towards the ventral side where positive.
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
    """Residual, stiffness and Newton's method of one unit cell; lengths in m, stresses in Pa."""

    def __init__(self, actuator: Actuator, counts: UnitCellMesh) -> None:
        self.grid: Grid = build(actuator, counts)
        mesh = self.grid.mesh
        self.points: FloatArray = mesh.points
        self.n = len(self.points)
        self.x_plane = actuator.pitch / 2
        self.bodies = [
            solid_body(mesh, self.grid.lower, actuator.materials.lower),
            solid_body(mesh, ~self.grid.lower, actuator.materials.upper),
        ]
        self.pressure = follower_pressure(mesh, self.grid.cavity)
        self.joined = np.flatnonzero(self.grid.plane)
        self.walls = [
            self._wall(self.grid.outer_wall),
            self._wall(self.grid.cavity & ~self.grid.middle),
        ]
        held = np.zeros((self.n, 3), dtype=bool)
        held[self.grid.middle, 0] = True
        held[self.grid.symmetry, 2] = True
        held[self.grid.ventral[0], 1] = True
        held[self.grid.plane, 0] = True  # their x follows from the plane
        self.free = np.append(np.flatnonzero(~held.ravel()), [3 * self.n, 3 * self.n + 1])

    def _wall(self, mask: NDArray[np.bool_]) -> tuple[NDArray[np.intp], FloatArray]:
        """Points of the faces in `mask` that look along x, and their contact stiffness."""
        region = surface(self.grid.mesh, mask)
        normal = region.dA.sum(1)
        along_x = np.abs(normal[0]) > 0.5 * np.linalg.norm(normal, axis=0)
        # equal shares: the consistent ones of an 8-node face are negative at its corners
        share = np.linalg.norm(normal, axis=0)[along_x] / 8
        faces = region.mesh.cells_faces[along_x].ravel()
        area = np.bincount(faces, np.repeat(share, 8), minlength=self.n)
        points = np.flatnonzero(area)
        return points, np.asarray(_CONTACT_STIFFNESS * area[points], dtype=float)

    def rest(self) -> State:
        unknowns = np.zeros(3 * self.n + 2)
        unknowns[3 * self.joined + 1] = self.points[self.joined, 1]
        return State(0.0, unknowns)

    def displacement(self, state: State) -> FloatArray:
        """Displacements (n, 3) in m."""
        values = state.unknowns[:-2].reshape(-1, 3).copy()
        u, phi = state.unknowns[-2:]
        distance = values[self.joined, 1]
        x, y = self.x_plane + u + distance * np.sin(phi), distance * np.cos(phi)
        values[self.joined, :2] = np.stack([x, y], -1) - self.points[self.joined, :2]
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
        pressed = self.pressure.assemble
        force -= pressed.vector(self.pressure.field, state.pressure).toarray()[:, 0]
        stiffness = stiffness - pressed.matrix(self.pressure.field, state.pressure)

        u, phi = state.unknowns[-2:]
        distance = state.unknowns[3 * self.joined + 1]
        tangent = plane.joined_tangent(self.joined, distance, phi, self.n)
        out = tangent.T @ force
        matrix = tangent.T @ stiffness @ tangent
        matrix = matrix + plane.joined_curvature(self.joined, distance, phi, force)
        position = self.points + values
        for (points, k), (shift, turn, foot, sign) in zip(
            self.walls, ((u, phi, self.x_plane, 1), (0.0, 0.0, 0.0, -1)), strict=True
        ):
            x, y = position[points, 0], position[points, 1]
            push, addition = plane.contact(points, sign * x, y, k, shift, turn, foot, self.n)
            push[0 : 3 * self.n : 3] *= sign
            if sign < 0:  # the middle of the chamber is fixed: nothing of its own moves
                push[-2:] = 0
                keep = (addition.row < 3 * self.n) & (addition.col < 3 * self.n)
                addition.data *= keep
            out = out + push
            matrix = matrix + addition
        out[-1] -= 0.5 * state.moment  # the cell is half the width
        return out, matrix.tocsr()

    def solve(self, state: State, pressure: float, moment: float = 0.0) -> State:
        """Equilibrium at `pressure` (Pa) and `moment` (N m) from a neighbouring state.

        Raises NotConverged.
        """
        unknowns = state.unknowns.copy()
        for _ in range(_ITERATIONS):
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
            if size < _TOLERANCE:
                return State(pressure, unknowns, moment)
        raise NotConverged(
            f"no equilibrium at {pressure / 1e3:.3g} kPa after {_ITERATIONS} iterations"
        )
