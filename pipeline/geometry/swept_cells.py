"""The cells of a swept mesh at one instant, and values carried from one mesh to another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
import xarray as xr
from numpy import ndarray
from scipy.spatial import cKDTree

from pipeline.geometry.quality import Edges, cell_areas, cell_centres, planform_edges


@dataclass(frozen=True)
class SweptCells:
    """Columns of a planform, and the column and layer of each cell."""

    outline: ndarray  # (column, 4, 2) corners; a triangle's last one twice
    edges: Edges
    centre: ndarray  # (column, 2) m
    area: ndarray  # (column,) m²
    middle: ndarray  # (edge, 2) m
    wall_velocity: ndarray  # (edge, 2) m/s, of the edges' middles, for edges that are walls
    levels: ndarray
    column: ndarray
    layer: ndarray

    @property
    def volume(self) -> ndarray:
        """Volume of each cell, m³."""
        return self.area[self.column] * np.diff(self.levels)[self.layer]

    def numbers(self) -> ndarray:
        """Number of the cell in each column and layer; -1 inside a body."""
        number = np.full((len(self.centre), len(self.levels) - 1), -1)
        number[self.column, self.layer] = np.arange(len(self.column))
        return number


def swept_cells(
    planform: xr.Dataset, sweep: xr.Dataset, nodes: ndarray, velocity: ndarray
) -> SweptCells:
    """The cells of a mesh whose nodes are at `nodes` (node, 2; m) and move with `velocity`."""
    triangles, quads = planform["triangles"].values, planform["quads"].values
    edges = planform_edges(triangles, quads)
    return SweptCells(
        nodes[np.vstack([triangles[:, [0, 1, 2, 2]], quads])],
        edges,
        cell_centres(nodes, triangles, quads),
        cell_areas(nodes, triangles, quads),
        nodes[edges.nodes].mean(1),
        velocity[edges.nodes].mean(1),
        planform["levels"].values,
        sweep["cell_column"].values,
        sweep["cell_layer"].values,
    )


@dataclass(frozen=True)
class _Overlap:
    """Parts that columns of two planforms share, with area (m²) and centroid (part, 2; m)."""

    source: ndarray
    target: ndarray
    area: ndarray
    centre: ndarray


def overlap_of(source: SweptCells, target: SweptCells) -> _Overlap:
    """All parts that the columns of two planforms share."""
    old, new = (shapely.polygons(cells.outline) for cells in (source, target))
    inside, cut = shapely.STRtree(old).query(new, predicate="intersects")
    shared = shapely.intersection(new[inside], old[cut])
    area = shapely.area(shared)
    real = area > 1e-9 * target.area[inside]  # neither points nor edges
    centre = shapely.get_coordinates(shapely.centroid(shared[real]))
    return _Overlap(cut[real], inside[real], area[real], centre)


def carry(
    source: SweptCells,
    target: SweptCells,
    overlap: _Overlap,
    values: ndarray,
    *,
    no_slip: bool,
) -> tuple[ndarray, ndarray]:
    """Values (cell, n) on another mesh of the same layers: cell averages, and samples at centres.

    Each source cell's value is continued linearly by its gradient, so that both are exact for
    linear fields. The averages keep sums over the volume but smooth, the samples do not smooth.
    Where `no_slip`, values are velocities, and walls count as neighbours.
    """
    averaged, sampled = (np.empty((len(target.column), values.shape[1])) for _ in range(2))
    number, wanted = source.numbers(), target.numbers()
    for layer in range(number.shape[1]):
        slope = _gradients(source, values, number[:, layer], no_slip)

        def continued(column, place, layer=layer, slope=slope):
            offset = place - source.centre[column]
            return values[number[column, layer]] + np.einsum("cd,cdn->cn", offset, slope[column])

        members, columns = (np.flatnonzero(n[:, layer] >= 0) for n in (number, wanted))
        cells = wanted[columns, layer]
        nearest = cKDTree(source.centre[members]).query(target.centre[columns])[1]
        sampled[cells] = continued(members[nearest], target.centre[columns])
        part = (number[overlap.source, layer] >= 0) & (wanted[overlap.target, layer] >= 0)
        part_cell = wanted[overlap.target[part], layer]
        weight = overlap.area[part]
        total = np.bincount(part_cell, weight, len(averaged))[cells]
        share = weight[:, None] * continued(overlap.source[part], overlap.centre[part])
        sums = [np.bincount(part_cell, column, len(averaged))[cells] for column in share.T]
        # less is a sliver at a wall, whose chords differ
        covered = total > 0.1 * target.area[columns]
        averaged[cells] = sampled[cells]
        averaged[cells[covered]] = np.stack(sums, 1)[covered] / total[covered, None]
    return averaged, sampled


def _gradients(cells: SweptCells, values: ndarray, number: ndarray, no_slip: bool) -> ndarray:
    """Gradients (column, axis, n) in one layer, by least squares over the neighbours.

    Weights are inverse squares of the distance.
    """
    left, right = cells.edges.left, cells.edges.right
    inner = right >= 0
    there, beyond = number[left] >= 0, inner & (number[right] >= 0)
    both = there & beyond
    own = [left[both], right[both]]
    offset = [cells.centre[right[both]] - cells.centre[left[both]]]
    rise = [values[number[right[both]]] - values[number[left[both]]]]
    offset.append(-offset[0])
    rise.append(-rise[0])
    if no_slip:
        for wall, cell in ((inner & there & ~beyond, left), (beyond & ~there, right)):
            own.append(cell[wall])
            offset.append(cells.middle[wall] - cells.centre[cell[wall]])
            speed = np.zeros((int(wall.sum()), values.shape[1]))
            speed[:, :2] = cells.wall_velocity[wall]
            rise.append(speed - values[number[cell[wall]]])
    owner, step, change = np.concatenate(own), np.vstack(offset), np.vstack(rise)
    weight = 1 / (step**2).sum(1)
    count = len(cells.centre)
    matrix = np.zeros((count, 2, 2))
    known = np.zeros((count, 2, values.shape[1]))
    np.add.at(matrix, owner, weight[:, None, None] * step[:, :, None] * step[:, None, :])
    np.add.at(known, owner, weight[:, None, None] * step[:, :, None] * change[:, None, :])
    # a cell with neighbours on one line only has no slope across it
    return np.linalg.pinv(matrix, rcond=1e-6, hermitian=True) @ known
