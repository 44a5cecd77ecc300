"""Field mapping between two mesh intervals: the earlier one's flow on the later one's mesh."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy import ndarray
from scipy.spatial import cKDTree

from pipeline.formats.mesh_intervals import IntervalMesh
from pipeline.geometry.quality import Edges, cell_areas, cell_centres, planform_edges
from pipeline.openfoam.case_folder import Case
from pipeline.openfoam.displacement_files import time_name
from pipeline.openfoam.foamfile import END, header, write_bytes, write_field
from pipeline.solve.checkpoint import saved_field


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


def swept_cells(mesh: IntervalMesh, time: float) -> SweptCells:
    """The cells of a mesh in its shape at `time` s."""
    nodes, velocity = mesh.motion.nodes(time), mesh.motion.velocity(time)
    triangles, quads = mesh.planform["triangles"].values, mesh.planform["quads"].values
    edges = planform_edges(triangles, quads)
    return SweptCells(
        nodes[np.vstack([triangles[:, [0, 1, 2, 2]], quads])],
        edges,
        cell_centres(nodes, triangles, quads),
        cell_areas(nodes, triangles, quads),
        nodes[edges.nodes].mean(1),
        velocity[edges.nodes].mean(1),
        mesh.planform["levels"].values,
        mesh.sweep["cell_column"].values,
        mesh.sweep["cell_layer"].values,
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


def square_sum(cells: SweptCells, a: ndarray, b: ndarray) -> float:
    """Integral of the product of two velocity fields (cell, 3) over the cells, m⁵/s²."""
    return float(np.sum(cells.volume * (a * b).sum(1)))


def energy_share(source: SweptCells, target: SweptCells, velocity: ndarray, averaged: ndarray,
                 sampled: ndarray) -> float:  # fmt: skip
    """The share s of `sampled` at which averaged + s (sampled - averaged) has the source's energy.

    Both are of second order. The share is limited to -1…2, so that a flow which neither describes
    is not forced to have the energy.
    """
    change = sampled - averaged
    a, b = square_sum(target, change, change), 2 * square_sum(target, averaged, change)
    c = square_sum(target, averaged, averaged) - square_sum(source, velocity, velocity)
    if a == 0:
        return 0.0
    return float(np.clip((-b + np.sqrt(max(b * b - 4 * a * c, 0.0))) / (2 * a), -1.0, 2.0))


def map_fields(old: Case, before: IntervalMesh, case: Case, mesh: IntervalMesh, step: int) -> None:
    """Write the first fields of `case`, at time step number `step`, from those of the case `old`.

    `before`, `mesh`: the meshes of both.
    """
    time = mesh.interval.begin
    name = time_name(time)
    new, templates = case.folder / name, case.folder / "0.orig"
    source, target = (swept_cells(each, time) for each in (before, mesh))
    velocity, pressure = (
        saved_field(old, f"{name}/{field}", len(source.column)) for field in ("U", "p")
    )
    overlap = overlap_of(source, target)
    averaged, sampled = carry(source, target, overlap, velocity, no_slip=True)
    share = energy_share(source, target, velocity, averaged, sampled)
    mapped = averaged + share * (sampled - averaged)
    first_guess = carry(source, target, overlap, pressure[:, None], no_slip=False)[0][:, 0]
    write_field(new / "U", templates / "U", mapped)
    write_field(new / "p", templates / "p", first_guess)
    for path in templates.iterdir():
        if not (new / path.name).exists():
            write_bytes(new / path.name, path.read_bytes() + END)
    # the sheet's pictures keep their phase over the field mapping
    index = b"index %d;\n" % step
    time_header = header("dictionary", f"{name}/uniform", "time", binary=False)
    write_bytes(new / "uniform" / "time", time_header + index + END)
