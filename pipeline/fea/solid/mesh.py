"""Second-order hexahedra of the whole finger in 3-D, half its width, by gmsh.

Frame: x along the finger from the root, y from the ventral surface into the chambers, z from the plane of symmetry.
"""

from __future__ import annotations

from dataclasses import dataclass

import gmsh
import numpy as np
from numpy.typing import NDArray

from pipeline.fea.cell.grid import wedge_height
from pipeline.fea.settings import Actuator, SolidMesh

FloatArray = NDArray[np.float64]
# gmsh numbers the middles of a hexahedron's edges in another order than CalculiX and Abaqus do
GMSH_TO_CALCULIX = [0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15]
HEX20 = 17  # gmsh's number of the element type
QUAD8 = 16


@dataclass(frozen=True)
class Solid:
    """20-node hexahedra in CalculiX's order; node numbers start at 0."""

    points: FloatArray  # (node, 3), m
    lower: NDArray[np.intp]  # (element, 20)
    upper: NDArray[np.intp]  # (element, 20)
    cavity: NDArray[np.intp]  # (face, 4) corners of the faces under pressure

    def nodes(self, axis: int, value: float) -> NDArray[np.intp]:
        """Nodes in the plane where coordinate `axis` is `value` (m)."""
        return np.flatnonzero(np.abs(self.points[:, axis] - value) < 1e-9)

    @property
    def ventral(self) -> NDArray[np.intp]:
        """Nodes of the profile of the lower layer, in the plane of symmetry, from the root to the tip."""
        line = np.intersect1d(self.nodes(1, 0.0), self.nodes(2, 0.0))
        return line[np.argsort(self.points[line, 0])]

    @property
    def dorsal(self) -> NDArray[np.intp]:
        """Nodes of the roofs' tops in the plane of symmetry."""
        line = np.intersect1d(self.nodes(1, float(self.points[:, 1].max())), self.nodes(2, 0.0))
        return line[np.argsort(self.points[line, 0])]


class _Blocks:
    """Hexahedral blocks on a lattice; points, edges and faces that blocks share are made once."""

    def __init__(self) -> None:
        self.points: dict[tuple[int, int, int], int] = {}
        self.edges: dict[tuple[int, int], int] = {}
        self.faces: dict[frozenset[int], int] = {}

    def point(self, key: tuple[int, int, int], place: FloatArray) -> int:
        if key not in self.points:
            self.points[key] = gmsh.model.geo.addPoint(*place)
        return self.points[key]

    def edge(self, a: int, b: int, elements: int) -> int:
        if (b, a) in self.edges:
            return -self.edges[b, a]
        if (a, b) not in self.edges:
            self.edges[a, b] = gmsh.model.geo.addLine(a, b)
            gmsh.model.geo.mesh.setTransfiniteCurve(self.edges[a, b], elements + 1)
        return self.edges[a, b]

    def face(self, corners: list[int], elements: tuple[int, int]) -> int:
        key = frozenset(corners)
        if key not in self.faces:
            pairs = zip(corners, corners[1:] + corners[:1], (elements * 2), strict=True)
            loop = gmsh.model.geo.addCurveLoop([self.edge(a, b, n) for a, b, n in pairs])
            self.faces[key] = gmsh.model.geo.addPlaneSurface([loop])
            gmsh.model.geo.mesh.setTransfiniteSurface(self.faces[key], cornerTags=corners)
            gmsh.model.geo.mesh.setRecombine(2, self.faces[key])
        return self.faces[key]

    def block(self, c: list[int], n: tuple[int, int, int]) -> int:
        """Volume of corners c (x fastest, then y, then z, counter-clockwise) with n elements along x, y, z."""
        nx, ny, nz = n
        faces = [
            self.face([c[0], c[1], c[2], c[3]], (nx, ny)),
            self.face([c[4], c[5], c[6], c[7]], (nx, ny)),
            self.face([c[0], c[1], c[5], c[4]], (nx, nz)),
            self.face([c[3], c[2], c[6], c[7]], (nx, nz)),
            self.face([c[0], c[3], c[7], c[4]], (ny, nz)),
            self.face([c[1], c[2], c[6], c[5]], (ny, nz)),
        ]
        volume = gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop(faces)])
        gmsh.model.geo.mesh.setTransfiniteVolume(volume, cornerTags=c)
        return int(volume)


def _columns(a: Actuator) -> tuple[FloatArray, list[str]]:
    """x of the lattice below h2, and what each column is."""
    widths, kinds = [], []
    for chamber in range(a.chambers):
        if chamber:
            widths.append(a.gap)
            kinds.append("gap")
        widths += [a.l1, a.l2, a.l1]
        kinds += ["wall", "cavity", "wall"]
    return np.concatenate([[0.0], np.cumsum(widths)]), kinds


def build(actuator: Actuator, counts: SolidMesh) -> Solid:
    """Mesh of the finger; raises RuntimeError where gmsh fails."""
    a, n = actuator, counts
    x, kinds = _columns(a)
    wedge = wedge_height(a)
    y = np.cumsum([0.0, a.b2, a.bridge, a.h2 - a.bridge, wedge, a.roof])
    z = np.array([0.0, a.width / 2 - a.b1, a.width / 2])
    slope = np.tan(np.deg2rad(a.wedge_deg))
    lean = np.array([0, 0, 0, 0, slope * wedge, slope * (wedge + a.roof)])
    along = {"wall": n.wall, "cavity": n.cavity, "gap": n.gap}
    rows = [n.base, n.bridge, n.side, n.wedge, n.wall]
    spans = [n.span, n.wall]

    def place(i: int, j: int, k: int) -> FloatArray:
        kind_left = kinds[i - 1] if i else "gap"
        kind_right = kinds[i] if i < len(kinds) else "gap"
        # left walls lean to the right and right walls to the left
        side = 1 if (kind_left, kind_right) in (("gap", "wall"), ("wall", "cavity")) else -1
        inner = "cavity" in (kind_left, kind_right)
        shift = lean[j]
        if inner and j == 5:  # an even spacing at the roof's top
            half = a.l2 / 2 + a.l1
            shift = a.l2 / 2 * lean[5] / half
        return np.array([x[i] + side * shift, y[j], z[k]])

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
        lattice = _Blocks()
        lower, upper, wetted = list[int](), list[int](), list[int]()
        for i, kind in enumerate(kinds):
            for j in range(5 if kind != "gap" else 2):
                for k in range(2):
                    if kind == "cavity" and 1 <= j <= 3 and k == 0:
                        continue
                    corners = [
                        lattice.point((i + di, j + dj, k + dk), place(i + di, j + dj, k + dk))
                        for dk in (0, 1)
                        for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1))
                    ]
                    volume = lattice.block(corners, (along[kind], rows[j], spans[k]))
                    (lower if j == 0 else upper).append(volume)
        for i, kind in enumerate(kinds):
            if kind == "cavity":
                wetted += _cavity_faces(lattice, i)
        gmsh.model.geo.synchronize()
        for dimension, tags, name in ((3, lower, "lower"), (3, upper, "upper"), (2, wetted, "cavity")):
            gmsh.model.addPhysicalGroup(dimension, tags, name=name)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        tags, places, _ = gmsh.model.mesh.getNodes()
        number = np.zeros(int(tags.max()) + 1, dtype=np.intp)
        number[tags] = np.arange(len(tags))
        hexahedra = [
            number[np.concatenate([gmsh.model.mesh.getElementsByType(HEX20, v)[1] for v in volumes])].reshape(
                -1, 20
            )
            for volumes in (lower, upper)
        ]
        faces = np.concatenate([gmsh.model.mesh.getElementsByType(QUAD8, f)[1] for f in wetted])
    except Exception as error:
        raise RuntimeError(f"gmsh could not mesh the finger: {error}") from error
    finally:
        gmsh.finalize()
    return Solid(
        points=places.reshape(-1, 3),
        lower=hexahedra[0][:, GMSH_TO_CALCULIX],
        upper=hexahedra[1][:, GMSH_TO_CALCULIX],
        cavity=number[faces].reshape(-1, 8)[:, :4],
    )


def _cavity_faces(lattice: _Blocks, i: int) -> list[int]:
    """The faces around the void of column i."""
    p = lattice.points
    keys = [
        [(i, 1, 0), (i + 1, 1, 0), (i + 1, 1, 1), (i, 1, 1)],
        [(i, 4, 0), (i + 1, 4, 0), (i + 1, 4, 1), (i, 4, 1)],
    ]
    for j in (1, 2, 3):
        keys += [[(c, j, 0), (c, j + 1, 0), (c, j + 1, 1), (c, j, 1)] for c in (i, i + 1)]
        keys.append([(i, j, 1), (i + 1, j, 1), (i + 1, j + 1, 1), (i, j + 1, 1)])
    return [lattice.faces[frozenset(p[key] for key in face)] for face in keys]
