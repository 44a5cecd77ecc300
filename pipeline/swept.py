"""The cells of a swept mesh at one instant, and values carried from one such mesh to another, layer by layer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.spatial import cKDTree

from pipeline.quality import Edges, cell_areas, cell_centres, planform_edges


@dataclass(frozen=True)
class SweptCells:
    """Columns of a planform with their centroids (column, 2; m) and areas, and the column and layer of each cell.

    `wall_velocity` (edge, 2; m/s) is that of the middle of each edge of the planform, for edges that are walls.
    """

    edges: Edges
    centre: np.ndarray
    area: np.ndarray
    middle: np.ndarray
    wall_velocity: np.ndarray
    levels: np.ndarray
    column: np.ndarray
    layer: np.ndarray

    @property
    def volume(self) -> np.ndarray:
        """Volume of each cell, m³."""
        return self.area[self.column] * np.diff(self.levels)[self.layer]

    def numbers(self) -> np.ndarray:
        """Number of the cell in each column and layer; -1 inside a body."""
        number = np.full((len(self.centre), len(self.levels) - 1), -1)
        number[self.column, self.layer] = np.arange(len(self.column))
        return number


def swept_cells(
    planform: xr.Dataset, sweep: xr.Dataset, nodes: np.ndarray, velocity: np.ndarray
) -> SweptCells:
    """The cells of a leg's mesh where its planform's nodes are at `nodes` (node, 2; m) and move with `velocity`."""
    triangles, quads = planform["triangles"].values, planform["quads"].values
    edges = planform_edges(triangles, quads)
    return SweptCells(
        edges,
        cell_centres(nodes, triangles, quads),
        cell_areas(nodes, triangles, quads),
        nodes[edges.nodes].mean(1),
        velocity[edges.nodes].mean(1),
        planform["levels"].values,
        sweep["cell_column"].values,
        sweep["cell_layer"].values,
    )


def carry(source: SweptCells, target: SweptCells, values: np.ndarray, *, no_slip: bool) -> np.ndarray:
    """Values (cell, n) on another mesh of the same layers: the nearest cell of the layer, continued by its gradient.

    Exact for fields that are linear in the plane. Where `no_slip`, values are velocities and walls count as neighbours.
    """
    result = np.empty((len(target.column), values.shape[1]))
    number = source.numbers()
    for layer in range(number.shape[1]):
        members = np.flatnonzero(number[:, layer] >= 0)
        slope = gradients(source, values, number[:, layer], no_slip)
        wanted = np.flatnonzero(target.layer == layer)
        place = target.centre[target.column[wanted]]
        nearest = members[cKDTree(source.centre[members]).query(place)[1]]
        way = place - source.centre[nearest]
        result[wanted] = values[number[nearest, layer]] + np.einsum("cd,cdn->cn", way, slope[nearest])
    return result


def gradients(cells: SweptCells, values: np.ndarray, number: np.ndarray, no_slip: bool) -> np.ndarray:
    """Gradients (column, axis, n) in one layer by least squares over the neighbours, weighted by inverse distance squared."""
    left, right = cells.edges.left, cells.edges.right
    inner = right >= 0
    there, beyond = number[left] >= 0, inner & (number[right] >= 0)
    both = there & beyond
    own = [left[both], right[both]]
    way = [cells.centre[right[both]] - cells.centre[left[both]]]
    rise = [values[number[right[both]]] - values[number[left[both]]]]
    way.append(-way[0])
    rise.append(-rise[0])
    if no_slip:
        for wall, cell in ((inner & there & ~beyond, left), (beyond & ~there, right)):
            own.append(cell[wall])
            way.append(cells.middle[wall] - cells.centre[cell[wall]])
            speed = np.zeros((int(wall.sum()), values.shape[1]))
            speed[:, :2] = cells.wall_velocity[wall]
            rise.append(speed - values[number[cell[wall]]])
    owner, step, change = np.concatenate(own), np.vstack(way), np.vstack(rise)
    weight = 1 / (step**2).sum(1)
    count = len(cells.centre)
    matrix = np.zeros((count, 2, 2))
    known = np.zeros((count, 2, values.shape[1]))
    np.add.at(matrix, owner, weight[:, None, None] * step[:, :, None] * step[:, None, :])
    np.add.at(known, owner, weight[:, None, None] * step[:, :, None] * change[:, None, :])
    # a cell with neighbours on one line only has no slope across it
    return np.linalg.pinv(matrix, rcond=1e-6, hermitian=True) @ known
