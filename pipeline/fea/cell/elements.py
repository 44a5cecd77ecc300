"""Finite elements of the unit cell: 20-node hexahedra and follower pressure on them."""

import felupe
from numpy import ndarray

from pipeline.fea.materials import strain_energy
from pipeline.fea.settings import Material

# 2 × 2 × 2 points, which keeps 20-node hexahedra free of locking
_REDUCED = felupe.GaussLegendre(order=1, dim=3)


def solid_body(mesh: felupe.Mesh, cells: ndarray, material: Material) -> felupe.SolidBody:
    """A body of the marked `cells`, with the volumetric energy K/2 (J − 1)²."""
    part = felupe.Mesh(mesh.points, mesh.cells[cells], mesh.cell_type)
    region = felupe.RegionQuadraticHexahedron(part, quadrature=_REDUCED)
    law = strain_energy(material) & felupe.Volumetric(bulk=material.bulk)
    return felupe.SolidBody(law, felupe.FieldContainer([felupe.Field(region, dim=3)]))


def surface(mesh: felupe.Mesh, points: ndarray) -> felupe.RegionQuadraticHexahedronBoundary:
    """Faces of the mesh's surface whose nodes are all marked in `points`."""
    return felupe.RegionQuadraticHexahedronBoundary(mesh, only_surface=True, mask=points)


def follower_pressure(mesh: felupe.Mesh, points: ndarray) -> felupe.SolidBodyPressure:
    """Pressure normal to the deformed faces of `surface`, as an external force."""
    field = felupe.Field(surface(mesh, points), dim=3)
    return felupe.SolidBodyPressure(felupe.FieldContainer([field]))
