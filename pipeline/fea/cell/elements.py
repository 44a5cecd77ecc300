"""The finite elements of the unit cell: 20-node hexahedra with reduced integration, and follower pressure on them."""

from __future__ import annotations

import felupe
import numpy as np
from numpy.typing import NDArray

from pipeline.fea.materials import law
from pipeline.fea.settings import Material

# 2 × 2 × 2 points, which keeps 20-node hexahedra free of locking
REDUCED = felupe.GaussLegendre(order=1, dim=3)


def solid_body(mesh: felupe.Mesh, cells: NDArray[np.bool_], material: Material) -> felupe.SolidBody:
    """A body of the marked `cells` of a mesh of 20-node hexahedra; its displacements are those of all points."""
    part = felupe.Mesh(mesh.points, mesh.cells[cells], mesh.cell_type)
    region = felupe.RegionQuadraticHexahedron(part, quadrature=REDUCED)
    return felupe.SolidBody(law(material), felupe.FieldContainer([felupe.Field(region, dim=3)]))


def surface(
    mesh: felupe.Mesh, points: NDArray[np.bool_]
) -> felupe.RegionQuadraticHexahedronBoundary:
    """The faces of a mesh's surface all of whose nodes are among the marked `points`."""
    return felupe.RegionQuadraticHexahedronBoundary(mesh, only_surface=True, mask=points)


def follower_pressure(mesh: felupe.Mesh, points: NDArray[np.bool_]) -> felupe.SolidBodyPressure:
    """Pressure normal to the deformed faces of `surface`; its vector and matrix are those of the external force."""
    return felupe.SolidBodyPressure(
        felupe.FieldContainer([felupe.Field(surface(mesh, points), dim=3)])
    )
