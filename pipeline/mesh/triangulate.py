"""Cells of a planform, by gmsh: the water beyond the finger's ring, and the finger's footprint."""

from dataclasses import dataclass
from itertools import pairwise

import gmsh
import numpy as np
from numpy import ndarray

from pipeline.scene.sections import Mesh
from piv.files.errors import StageError

_GROWTH = 0.3  # of the cell size with the distance from a gap, where mesh.wall_grading says nothing
_LEAST_SINE = 0.45  # of a quadrilateral's corners: others are split in two
_BIN = 1.25  # points in gaps are taken together where their sizes differ by less than this factor


_THRESHOLD = ("InField", "SizeMin", "SizeMax", "DistMin", "DistMax")
_OPTIONS = {
    "General.Terminal": 0,
    "Mesh.Algorithm": 6,
    "Mesh.RandomSeed": 1,
    "Mesh.MeshSizeExtendFromBoundary": 0,
    "Mesh.MeshSizeFromPoints": 0,
}


@dataclass(frozen=True)
class Triangles:
    """Nodes (node, 2) m, first the rim's, then the wall's; triangles, and quads of the water."""

    nodes: ndarray
    triangles: ndarray
    quads: ndarray
    inside: ndarray  # (triangle,) 1 within the wall
    outer: ndarray  # nodes of the tank's outline, counter-clockwise from the lower left
    on_bodies: ndarray  # nodes of the outlines of bodies


def triangulate(
    wall: ndarray,
    rim: ndarray,
    box: tuple[float, float, float],
    mesh: Mesh,
    path: ndarray,
    bodies: list[ndarray],
    gaps: tuple[ndarray, ndarray],
) -> Triangles:
    """Mesh a tank `box` (left, right, depth) around the polygon rim and within the polygon wall.

    `bodies`: polylines that the triangles follow; a closed one repeats its first point, an open one
    ends on the right side. `gaps`: points (n, 2) in narrow gaps and cell sizes (n,) there, m.
    """
    gmsh.initialize(interruptible=False)
    try:
        for name, value in _OPTIONS.items():
            gmsh.option.setNumber(name, value)
        rim_lines, wall_lines = _polygon(rim), _polygon(wall)
        box_lines, body_lines = _outer_lines(box, bodies)
        geo = gmsh.model.geo
        rim_loop, wall_loop, box_loop = (
            geo.addCurveLoop(x) for x in (rim_lines, wall_lines, box_lines)
        )
        water = geo.addPlaneSurface([box_loop, rim_loop])
        footprint = geo.addPlaneSurface([wall_loop])
        track, narrow = ([geo.addPoint(x, y, 0) for x, y in points] for points in (path, gaps[0]))
        geo.synchronize()
        for line in rim_lines + wall_lines + body_lines:
            gmsh.model.mesh.setTransfiniteCurve(line, 2)
        if body_lines:
            gmsh.model.mesh.embed(1, body_lines, 2, water)
        _size_field(rim_lines + wall_lines + body_lines, track, narrow, gaps[1], mesh)
        if mesh.planform == "quads":
            gmsh.model.mesh.setRecombine(2, water)
        gmsh.model.mesh.generate(2)
        return _collect(water, footprint, rim_lines + wall_lines, box_lines, body_lines)
    finally:
        gmsh.finalize()


def _polygon(points: ndarray) -> list[int]:
    tags = [gmsh.model.geo.addPoint(x, y, 0) for x, y in points]
    return [gmsh.model.geo.addLine(a, b) for a, b in zip(tags, tags[1:] + tags[:1], strict=True)]


def _outer_lines(
    box: tuple[float, float, float], bodies: list[ndarray]
) -> tuple[list[int], list[int]]:
    """Lines of the tank, split where bodies end on its right side, and of the bodies."""
    left, right, depth = box
    geo = gmsh.model.geo
    ends = [line[k] for line in bodies if not (line[0] == line[-1]).all() for k in (0, -1)]
    heights = sorted(float(y) for _, y in ends)
    corners = [(left, 0.0), *((right, y) for y in (0.0, *heights, depth)), (left, depth)]
    tags = [geo.addPoint(x, y, 0) for x, y in corners]
    outer = [geo.addLine(a, b) for a, b in zip(tags, tags[1:] + tags[:1], strict=True)]
    on_side = dict(zip(heights, tags[2:], strict=False))
    inner = []
    for line in bodies:
        points = [geo.addPoint(x, y, 0) for x, y in line[1:-1]]
        if (line[0] == line[-1]).all():
            first = geo.addPoint(*line[0], 0)
            points = [first, *points, first]
        else:
            points = [on_side[float(line[0, 1])], *points, on_side[float(line[-1, 1])]]
        inner += [geo.addLine(a, b) for a, b in pairwise(points)]
    return outer, inner


def _collect(
    water: int, footprint: int, first_lines: list[int], box_lines: list[int], body_lines: list[int]
) -> Triangles:
    """What gmsh has meshed, renumbered: nodes at the starts of `first_lines` first."""
    tags, xyz, _ = gmsh.model.mesh.getNodes()
    position = dict(zip(tags.tolist(), range(len(tags)), strict=True))
    xy = xyz.reshape(-1, 3)[:, :2]
    water_cells, footprint_cells = _cells(water, position), _cells(footprint, position)

    def ends(line: int) -> list[int]:
        points = gmsh.model.getAdjacencies(1, line)[1]
        return [position[int(gmsh.model.mesh.getNodes(0, int(p))[0][0])] for p in points]

    outer = []
    for line in box_lines:
        outer.append(ends(line)[0])
        line_tags, _, parameter = gmsh.model.mesh.getNodes(1, line)
        outer += [position[int(t)] for t in line_tags[np.argsort(parameter)]]
    first = np.array([ends(line)[0] for line in first_lines])
    used = np.concatenate([c.ravel() for c in (*water_cells, *footprint_cells)])
    rest = np.setdiff1d(used, first)
    order = np.concatenate([first, rest])
    new = np.full(len(xy), -1)
    new[order] = np.arange(len(order))
    nodes = xy[order]
    quads, split = _split_bad_quads(nodes, _turned(nodes, new[water_cells[1]]))
    triangles = np.vstack([new[water_cells[0]], split, new[footprint_cells[0]]])
    inside = np.repeat([0, 1], [len(water_cells[0]) + len(split), len(footprint_cells[0])])
    on_bodies = np.unique([n for line in body_lines for n in ends(line)]).astype(int)
    return Triangles(
        nodes, _turned(nodes, triangles), quads, inside, new[np.array(outer)], new[on_bodies]
    )


def _cells(surface: int, position: dict[int, int]) -> tuple[ndarray, ndarray]:
    """Triangles (n, 3) and quadrilaterals (n, 4) of a surface; `position` of gmsh's node tags."""
    kinds, _, members = gmsh.model.mesh.getElements(2, surface)
    elements = {
        kind: np.array([position[t] for t in tags.tolist()])
        for kind, tags in zip(kinds, members, strict=True)
    }
    if not elements or not elements.keys() <= {2, 3}:
        raise StageError(
            "the planform could not be meshed; make mesh.wall_cell or mesh.near_cell smaller"
        )
    empty = np.empty(0, int)
    return elements.get(2, empty).reshape(-1, 3), elements.get(3, empty).reshape(-1, 4)


def _turned(nodes: ndarray, cells: ndarray) -> ndarray:
    """Cells (n, corner) with all corners counter-clockwise."""
    x, y = (nodes[cells, axis] for axis in (0, 1))
    area = (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(1)
    return np.where(area[:, None] < 0, cells[:, ::-1], cells)


def _split_bad_quads(nodes: ndarray, quads: ndarray) -> tuple[ndarray, ndarray]:
    """Counter-clockwise quads whose corners have a sine of _LEAST_SINE; halves of the others."""
    area, ahead, behind = _corners(nodes, quads)
    bad = (area / (ahead * behind)).min(axis=1, initial=1.0) < _LEAST_SINE
    return quads[~bad], halves(nodes, quads[bad])


def halves(nodes: ndarray, quads: ndarray) -> ndarray:
    """Triangles (2 n, 3) of quads (n, 4), split so that the smaller half is large."""
    area, _, _ = _corners(nodes, quads)
    # the halves of diagonal 0-2 are the triangles at corners 1 and 3
    turn = area[:, [0, 2]].min(axis=1) > area[:, [1, 3]].min(axis=1)
    q = np.where(turn[:, None], np.roll(quads, -1, axis=1), quads)
    return np.vstack([q[:, [0, 1, 2]], q[:, [2, 3, 0]]])


def _corners(nodes: ndarray, quads: ndarray) -> tuple[ndarray, ndarray, ndarray]:
    """At each corner (n, 4): twice the area spanned by its two edges, and their lengths."""
    corner = nodes[quads]
    ahead, behind = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    area = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]
    return area, np.linalg.norm(ahead, axis=-1), np.linalg.norm(behind, axis=-1)


def _size_field(
    walls: list[int], track: list[int], narrow: list[int], size: ndarray, mesh: Mesh
) -> None:
    """Cell size growing from the walls and the tip's path; `size` at points `narrow`."""
    fields = gmsh.model.mesh.field

    def graded(kind: str, members: list[int], size: float, near: float, growth: float) -> int:
        far = mesh.near_distance + 5 * mesh.far_cell
        if growth:
            far = near + (mesh.far_cell - size) / growth
        distance = fields.add("Distance")
        fields.setNumbers(distance, kind, members)
        fields.setNumber(distance, "Sampling", 2)
        threshold = fields.add("Threshold")
        values = distance, size, mesh.far_cell, near, far
        for key, value in zip(_THRESHOLD, values, strict=True):
            fields.setNumber(threshold, key, value)
        return threshold

    growth = mesh.wall_grading if mesh.near == "tip" else 0.0
    parts = [graded("CurvesList", walls, 1.1 * mesh.wall_cell, mesh.wall_distance, growth)]
    parts.append(graded("PointsList", track, mesh.near_cell, mesh.near_distance, growth))
    bins, points = np.round(np.log(size) / np.log(_BIN)), np.array(narrow)
    for chosen in np.unique(bins):
        least = float(_BIN**chosen)
        members = points[bins == chosen].tolist()
        parts.append(graded("PointsList", members, least, least, mesh.wall_grading or _GROWTH))
    smallest = fields.add("Min")
    fields.setNumbers(smallest, "FieldsList", parts)
    fields.setAsBackgroundMesh(smallest)
