"""Second-order hexahedra of the whole finger in 3-D, half its width.

Frame: x along the finger from the root, y from the ventral surface into the chambers, z from the plane of symmetry.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from pipeline.fea.cell.grid import wedge_height
from pipeline.fea.lattice import hexahedra, lattice_line
from pipeline.fea.settings import Actuator, SolidMesh

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Solid:
    """20-node hexahedra in CalculiX's order; node numbers start at 0."""

    points: FloatArray  # (node, 3), m
    lower: NDArray[np.intp]  # (element, 20)
    upper: NDArray[np.intp]  # (element, 20)
    cavity: NDArray[np.bool_]  # (node) wetted by the pressure

    def nodes(self, axis: int, value: float) -> NDArray[np.intp]:
        """Nodes in the plane where coordinate `axis` is `value` (m)."""
        return np.flatnonzero(np.abs(self.points[:, axis] - value) < 1e-9)

    def line(self, height: float) -> NDArray[np.intp]:
        """Nodes at y = `height` (m) in the plane of symmetry, from the root to the tip."""
        line = np.intersect1d(self.nodes(1, height), self.nodes(2, 0.0))
        return line[np.argsort(self.points[line, 0])]

    @property
    def ventral(self) -> NDArray[np.intp]:
        """Nodes of the profile of the lower layer."""
        return self.line(0.0)

    @property
    def dorsal(self) -> NDArray[np.intp]:
        """Nodes of the roofs' tops."""
        return self.line(float(self.points[:, 1].max()))


def build(actuator: Actuator, counts: SolidMesh) -> Solid:
    """Structured hexahedra, split into blocks (wall, cavity, wall, gap, …) × (base, bridge, side, wedge, roof) × (span, wall)."""
    a, n = actuator, counts
    kinds = (["wall", "cavity", "wall", "gap"] * a.chambers)[:-1]
    lengths = {"wall": a.l1, "cavity": a.l2, "gap": a.gap}
    elements = (
        [getattr(n, kind) for kind in kinds],
        [n.base, n.bridge, n.side, n.wedge, n.wall],
        [n.span, n.wall],
    )
    wedge = wedge_height(a)
    x = np.cumsum([0.0, *(lengths[kind] for kind in kinds)])
    y = np.cumsum([0.0, a.b2, a.bridge, a.h2 - a.bridge, wedge, a.roof])
    z = np.array([0.0, a.width / 2 - a.b1, a.width / 2])

    # above h2 the walls lean towards the middle of their chamber; an even spacing at the roof's top
    slope = np.tan(np.deg2rad(a.wedge_deg))
    lean = np.tile([0, 0, 0, 0, slope * wedge, slope * (wedge + a.roof)], (len(x), 1))
    inner = np.arange(len(x)) % 4 % 3 > 0
    lean[inner, 5] *= a.l2 / 2 / (a.l2 / 2 + a.l1)
    corners = x[:, None] + np.resize([1, 1, -1, -1], len(x))[:, None] * lean

    column, row, span = np.meshgrid(
        *(np.repeat(np.arange(len(c)), c) for c in elements), indexing="ij"
    )
    kind = np.array(kinds)[column]
    void = (kind == "cavity") & (row >= 1) & (row <= 3) & (span == 0)
    kept = ~void & ~((kind == "gap") & (row >= 2))
    cells, places = hexahedra(kept)
    # where each node is, in blocks from the first
    i, j, k = (
        lattice_line(range(len(c) + 1), c)[p] for c, p in zip(elements, places.T, strict=True)
    )
    blocks = np.arange(len(x)), np.arange(len(y))
    points = [
        RegularGridInterpolator(blocks, corners)((i, j)),
        np.interp(j, blocks[1], y),
        np.interp(k, [0, 1, 2], z),
    ]
    in_cavity = (i % 4 >= 1) & (i % 4 <= 2)
    lower = row[kept] == 0
    return Solid(
        points=np.stack(points, -1),
        lower=cells[lower],
        upper=cells[~lower],
        cavity=in_cavity & (j >= 1) & (j <= 4) & (k <= 1),
    )
