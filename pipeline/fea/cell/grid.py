"""Mesh of 20-node hexahedra of the unit cell: half a pitch and half the width of one chamber.

Frame of the unit cell: x along the finger from the middle of the chamber to the middle of the gap, y from the
ventral surface into the chamber, z from the plane of symmetry to the side.
"""

from __future__ import annotations

from dataclasses import dataclass

import felupe
import numpy as np
from numpy.typing import NDArray

from pipeline.fea.lattice import hexahedra, lattice_line
from pipeline.fea.settings import Actuator, UnitCellMesh

# m; the wedge is cut where its half length would fall below this, for the sake of the elements
APEX = 0.15e-3


@dataclass(frozen=True)
class Grid:
    """Mesh of the unit cell: `lower` marks the cells of the lower layer, the others are masks of points."""

    mesh: felupe.Mesh
    lower: NDArray[np.bool_]
    middle: NDArray[np.bool_]  # x = 0, the middle of the chamber
    symmetry: NDArray[np.bool_]  # z = 0
    plane: NDArray[np.bool_]  # the middle of the gap, where neighbouring cells are joined
    cavity: NDArray[np.bool_]  # wetted by the pressure
    outer_wall: NDArray[np.bool_]  # may touch the neighbouring chamber
    ventral: NDArray[np.intp]  # points of the profile of the lower layer, by x
    top: NDArray[np.intp]  # points of the roof's outer edge at z = 0, by x


def wedge_height(actuator: Actuator) -> float:
    """Height (m) of the cavity's wedge: h1 − h2, or less where the walls meet before."""
    slope = np.tan(np.deg2rad(actuator.wedge_deg))
    full = actuator.h1 - actuator.h2
    return float(min(full, (actuator.l2 / 2 - APEX) / slope)) if slope > 0 else full


def build(actuator: Actuator, counts: UnitCellMesh) -> Grid:
    """Structured hexahedra, split into blocks (cavity, wall, gap) × (base, bridge, side, wedge, roof) × (span, wall)."""
    a, n = actuator, counts
    wedge = wedge_height(a)
    heights = np.cumsum([0.0, a.b2, a.bridge, a.h2 - a.bridge, wedge, a.roof]).tolist()
    x_line = lattice_line([0, a.l2 / 2, a.l2 / 2 + a.l1, a.pitch / 2], [n.cavity, n.wall, n.gap])
    y_line = lattice_line(heights, [n.base, n.bridge, n.side, n.wedge, n.wall])
    z_line = lattice_line([0, a.width / 2 - a.b1, a.width / 2], [n.span, n.wall])
    i, j, k = np.meshgrid(
        *(np.arange(len(line)) for line in (x_line, y_line, z_line)), indexing="ij"
    )
    x, y, z = x_line[i], y_line[j], z_line[k]
    # indices of the lattice at which the blocks end
    x1, x2 = 2 * n.cavity, 2 * (n.cavity + n.wall)
    y1, y2 = 2 * n.base, 2 * (n.base + n.bridge)
    y4 = y2 + 2 * (n.side + n.wedge)
    z1 = 2 * n.span

    # above h2 the cavity's wall and the outer wall lean in by the wedge angle, with the same length of wall
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

    ci, cj, ck = 2 * np.indices([length // 2 for length in i.shape])
    void = (ci < x1) & (cj >= y1) & (cj < y4) & (ck < z1)
    open_gap = (ci >= x2) & (cj >= y2)
    kept = ~(void | open_gap)
    cells, places = hexahedra(kept)
    pi, pj, pk = places.T
    points = np.stack([x, y, z], -1)[pi, pj, pk]
    cavity = (pi <= x1) & (pj >= y1) & (pj <= y4) & (pk <= z1)
    ventral = np.flatnonzero((pj == 0) & (pk == 0))
    top = np.flatnonzero((pj == len(y_line) - 1) & (pk == 0))
    return Grid(
        mesh=felupe.Mesh(points, cells, "hexahedron20"),
        lower=(cj < y1)[kept],
        middle=pi == 0,
        symmetry=pk == 0,
        plane=pi == len(x_line) - 1,
        cavity=cavity,
        outer_wall=(pi == x2) & (pj >= y2),
        ventral=ventral[np.argsort(points[ventral, 0])],
        top=top[np.argsort(points[top, 0])],
    )
