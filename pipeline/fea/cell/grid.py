"""Mesh of 20-node hexahedra of the unit cell: half a pitch and half the width of one chamber.

Frame: x along the finger from the middle of the chamber to the middle of the gap, y from the
ventral surface into the chamber, z from the plane of symmetry to the side.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import felupe
import numpy as np
from numpy.typing import NDArray

from pipeline.fea.settings import Actuator, UnitCellMesh
from pipeline.formats.bending_states import FloatArray

# m; the wedge is cut where its half length would fall below this, for the sake of the elements
_APEX = 0.15e-3
# Nodes on the lattice of half elements: corners, middles of the edges below, above, upright.
_NODES = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
_NODES += [(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)]
_NODES += [(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)]


@dataclass(frozen=True)
class Grid:
    """Mesh of the unit cell: `lower` marks the cells of the lower layer, the others mark points."""

    mesh: felupe.Mesh
    lower: NDArray[np.bool_]
    middle: NDArray[np.bool_]  # x = 0, the middle of the chamber
    symmetry: NDArray[np.bool_]  # z = 0
    plane: NDArray[np.bool_]  # the middle of the gap, where neighbouring cells are joined
    cavity: NDArray[np.bool_]  # wetted by the pressure
    outer_wall: NDArray[np.bool_]  # may touch the neighbouring chamber
    ventral: NDArray[np.intp]  # points of the profile of the lower layer, by x
    top: NDArray[np.intp]  # points of the roof's outer edge at z = 0, by x


def _wedge_height(actuator: Actuator) -> float:
    """Height (m) of the cavity's wedge: h1 − h2, or less where the walls meet before."""
    slope = np.tan(np.deg2rad(actuator.wedge_deg))
    full = actuator.h1 - actuator.h2
    return float(min(full, (actuator.l2 / 2 - _APEX) / slope)) if slope > 0 else full


def _lattice_line(breaks: Sequence[float], counts: Sequence[int]) -> FloatArray:
    """Coordinates of the corners and middles of `counts` elements between breaks."""
    ends = zip(breaks[:-1], breaks[1:], counts, strict=True)
    parts = [np.linspace(a, b, 2 * n, endpoint=False) for a, b, n in ends]
    return np.concatenate([*parts, [breaks[-1]]])


def build(actuator: Actuator, counts: UnitCellMesh) -> Grid:
    """Structured hexahedra.

    Blocks: (cavity, wall, gap) × (base, bridge, side, wedge, roof) × (span, wall).
    """
    a, n = actuator, counts
    wedge = _wedge_height(a)
    heights = np.cumsum([0.0, a.b2, a.bridge, a.h2 - a.bridge, wedge, a.roof]).tolist()
    lengths = [0, a.l2 / 2, a.l2 / 2 + a.l1, a.pitch / 2]
    x_line = _lattice_line(lengths, [n.cavity, n.wall, n.gap])
    y_line = _lattice_line(heights, [n.base, n.bridge, n.side, n.wedge, n.wall])
    z_line = _lattice_line([0, a.width / 2 - a.b1, a.width / 2], [n.span, n.wall])
    shape = len(x_line), len(y_line), len(z_line)
    i, j, k = np.indices(shape)
    x, y, z = x_line[i], y_line[j], z_line[k]
    # indices of the lattice at which the blocks end
    x1, x2 = 2 * n.cavity, 2 * (n.cavity + n.wall)
    y1, y2 = 2 * n.base, 2 * (n.base + n.bridge)
    y4 = y2 + 2 * (n.side + n.wedge)
    z1 = 2 * n.span

    # above h2 the cavity's wall and the outer wall lean in by the wedge angle, equally thick
    slope = np.tan(np.deg2rad(a.wedge_deg))
    inset = slope * np.clip(y - heights[3], 0, wedge)
    lean = slope * np.maximum(y - heights[3], 0)
    inner = a.l2 / 2 - inset
    outer = a.l2 / 2 + a.l1 - np.minimum(lean, slope * (wedge + a.roof))
    sheared = np.where(i <= x1, inner * i / x1, inner + (outer - inner) * (i - x1) / (x2 - x1))
    # within the roof the lines spread out towards an even spacing at its top
    rise = np.clip((y - heights[4]) / a.roof, 0, 1)
    sheared = (1 - rise) * sheared + rise * outer * i / x2
    x = np.where(i <= x2, sheared, x)

    ci, cj, ck = 2 * np.indices([size // 2 for size in shape])
    void = (ci < x1) & (cj >= y1) & (cj < y4) & (ck < z1)
    kept = ~void & ~((ci >= x2) & (cj >= y2))
    number = np.arange(x.size).reshape(shape)
    ends = [tuple(slice(c, c + s - 1, 2) for c, s in zip(p, shape, strict=True)) for p in _NODES]
    cells = np.stack([number[end] for end in ends], -1)[kept]
    used, numbers = np.unique(cells, return_inverse=True)
    pi, pj, pk = np.unravel_index(used, shape)
    points = np.stack([x, y, z], -1)[pi, pj, pk]

    def line(height: int) -> NDArray[np.intp]:
        members = np.flatnonzero((pj == height) & (pk == 0))
        return members[np.argsort(points[members, 0])]

    return Grid(
        mesh=felupe.Mesh(points, numbers.reshape(cells.shape), "hexahedron20"),
        lower=(cj < y1)[kept],
        middle=pi == 0,
        symmetry=pk == 0,
        plane=pi == shape[0] - 1,
        cavity=(pi <= x1) & (pj >= y1) & (pj <= y4) & (pk <= z1),
        outer_wall=(pi == x2) & (pj >= y2),
        ventral=line(0),
        top=line(shape[1] - 1),
    )
