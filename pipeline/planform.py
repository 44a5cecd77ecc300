"""The planform: a 2-D mesh of tank and finger, quads along the wall and triangles elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import gmsh
import numpy as np

from pipeline.errors import StageError
from pipeline.scene import Mesh


@dataclass(frozen=True)
class Planform:
    """Nodes (node, 2) in m, triangles and quads as node indices, and where the boundaries are.

    `material` gives, for each node of `wall`, its position along the outline as a fractional point index.
    """

    nodes: np.ndarray
    triangles: np.ndarray
    quads: np.ndarray
    inside: np.ndarray  # per triangle: 1 within the finger's footprint
    wall: np.ndarray  # nodes of the finger's outline, counter-clockwise
    material: np.ndarray
    outer: np.ndarray  # nodes of the tank's outline, counter-clockwise from the lower left
    corners: tuple[tuple[float, float], tuple[float, float]] = field(default=((0, 0), (0, 0)))


def outline_at(outline: np.ndarray, material: np.ndarray) -> np.ndarray:
    """Points (…, node, 2) of closed outlines (…, point, 2) at fractional point indices."""
    closed = np.concatenate([outline, outline[..., :1, :]], axis=-2)
    index = np.minimum(material.astype(int), outline.shape[-2] - 1)
    part = (material - index)[:, None]
    return closed[..., index, :] * (1 - part) + closed[..., index + 1, :] * part


def wall_nodes(outline: np.ndarray, tip: np.ndarray, mesh: Mesh) -> np.ndarray:
    """Fractional point indices along a closed outline, spaced `tip_cell` near the tip or tips, `wall_cell` elsewhere."""
    closed = np.vstack([outline, outline[:1]])
    step = np.hypot(*np.diff(closed, axis=0).T)
    walk = np.concatenate([[0], np.cumsum(step)])
    fine = np.linspace(0, walk[-1], 20 * len(outline), endpoint=False)
    x, y = np.interp(fine, walk, closed[:, 0]), np.interp(fine, walk, closed[:, 1])
    distance = np.min([np.hypot(x - a, y - b) for a, b in np.atleast_2d(tip)], axis=0)
    blend = np.clip((distance - 0.012) / 0.02, 0, 1)
    size = mesh.tip_cell + (mesh.wall_cell - mesh.tip_cell) * blend
    count_walk = np.concatenate([[0], np.cumsum((fine[1] - fine[0]) / size)])
    count = max(24, round(count_walk[-1]))
    at = np.interp(
        np.linspace(0, count_walk[-1], count, endpoint=False), count_walk, np.append(fine, walk[-1])
    )
    return np.interp(at, walk, np.arange(len(walk)))


def ring_layers(wall: np.ndarray, mesh: Mesh) -> list[np.ndarray]:
    """Closed polygons from the wall outwards; smoothed normals keep neighbouring spokes from crossing."""
    ahead, behind = np.roll(wall, -1, axis=0), np.roll(wall, 1, axis=0)
    edge = ahead - behind
    normal = np.column_stack([edge[:, 1], -edge[:, 0]])  # outwards of a counter-clockwise polygon
    normal /= np.hypot(*normal.T)[:, None]
    layers, height = [wall], mesh.wall_first_layer
    for _ in range(mesh.wall_layers):
        normal = normal + 0.5 * (np.roll(normal, 1, axis=0) + np.roll(normal, -1, axis=0))
        normal /= np.hypot(*normal.T)[:, None]
        layers.append(layers[-1] + height * normal)
        height *= mesh.wall_growth
    return layers


def build_planform(outline: np.ndarray, tip: np.ndarray, half_width: float, depth: float, mesh: Mesh,
                   path: np.ndarray, left: float | None = None, right: float | None = None) -> Planform:  # fmt: skip
    """Mesh the water around (and the footprint of) a finger given by its closed `outline` (point, 2).

    `path` (n, 2) holds points that the tip passes: cells stay small within `near_distance` of them. The tank spans
    ±`half_width` unless `left` or `right` moves a side (a symmetry plane), and 0…`depth`.
    """
    left, right = -half_width if left is None else left, half_width if right is None else right
    area = 0.5 * np.sum(
        outline[:, 0] * np.roll(outline[:, 1], -1) - np.roll(outline[:, 0], -1) * outline[:, 1]
    )
    material = wall_nodes(outline, tip, mesh)
    if area < 0:
        material = material[::-1]
    layers = ring_layers(outline_at(outline, material), mesh)
    count = len(material)
    rim = layers[-1]
    nodes, triangles, inside, outer = _triangulate(layers[0], rim, (left, right, depth), mesh, path)
    # gmsh numbers: outer rim first, then the wall, then its own; put the ring's inner polygons behind them
    middle = np.vstack(layers[1:-1]) if len(layers) > 2 else np.empty((0, 2))
    first_middle = len(nodes)
    nodes = np.vstack([nodes, middle])
    row = [np.arange(count) + count]
    row += [first_middle + k * count + np.arange(count) for k in range(len(layers) - 2)]
    row += [np.arange(count)]
    quads = np.vstack([np.column_stack([a, b, np.roll(b, -1), np.roll(a, -1)]) for a, b in pairwise(row)])
    return Planform(nodes, triangles, quads, inside, row[0], material, outer, ((left, 0.0), (right, depth)))


def _triangulate(wall: np.ndarray, rim: np.ndarray, box: tuple[float, float, float], mesh: Mesh,
                 path: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Triangles of the footprint and of the water beyond the ring; nodes start with the rim's, then the wall's."""
    left, right, depth = box
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.Algorithm", 6)
        gmsh.option.setNumber("Mesh.RandomSeed", 1)
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
        geo = gmsh.model.geo

        def polygon(points: np.ndarray) -> tuple[list[int], list[int]]:
            tags = [geo.addPoint(x, y, 0) for x, y in points]
            return tags, [geo.addLine(a, b) for a, b in zip(tags, tags[1:] + tags[:1], strict=True)]

        _, rim_lines = polygon(rim)
        _, wall_lines = polygon(wall)
        corner_tags, box_lines = polygon(np.array([[left, 0], [right, 0], [right, depth], [left, depth]]))
        rim_loop, wall_loop, box_loop = (geo.addCurveLoop(x) for x in (rim_lines, wall_lines, box_lines))
        water = geo.addPlaneSurface([box_loop, rim_loop])
        body = geo.addPlaneSurface([wall_loop])
        track = [geo.addPoint(x, y, 0) for x, y in path]
        geo.synchronize()
        for line in rim_lines + wall_lines:
            gmsh.model.mesh.setTransfiniteCurve(line, 2)
        _size_field(rim_lines, wall_lines, track, mesh)
        gmsh.model.mesh.generate(2)
        tags, xyz, _ = gmsh.model.mesh.getNodes()
        position = dict(zip(tags.tolist(), range(len(tags)), strict=True))
        xy = xyz.reshape(-1, 3)[:, :2]
        cells = []
        for surface in (water, body):
            kinds, _, members = gmsh.model.mesh.getElements(2, surface)
            if list(kinds) != [2]:
                raise StageError(
                    "the planform could not be meshed; make mesh.wall_cell or mesh.near_cell smaller"
                )
            cells.append(np.array([position[t] for t in members[0].tolist()]).reshape(-1, 3))
        rim_nodes = [position[int(gmsh.model.mesh.getNodes(0, int(p))[0][0])] for p in _starts(rim_lines)]
        wall_nodes_ = [position[int(gmsh.model.mesh.getNodes(0, int(p))[0][0])] for p in _starts(wall_lines)]
        outer = []
        for line, corner in zip(box_lines, corner_tags, strict=True):
            outer.append(position[int(gmsh.model.mesh.getNodes(0, corner)[0][0])])
            line_tags, _, parameter = gmsh.model.mesh.getNodes(1, line)
            outer += [position[int(t)] for t in line_tags[np.argsort(parameter)]]
    finally:
        gmsh.finalize()
    first = np.array(rim_nodes + wall_nodes_)
    used = np.unique(np.concatenate([*(c.ravel() for c in cells)]))
    rest = np.setdiff1d(used, first)
    order = np.concatenate([first, rest])
    new = np.full(len(xy), -1)
    new[order] = np.arange(len(order))
    triangles = new[np.vstack(cells)]
    inside = np.repeat([0, 1], [len(cells[0]), len(cells[1])])
    nodes = xy[order]
    a, b, c = (nodes[triangles[:, k]] for k in range(3))
    flipped = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] < 0
    triangles[flipped] = triangles[flipped][:, ::-1]
    return nodes, triangles, inside, new[np.array(outer)]


def _starts(lines: list[int]) -> list[int]:
    return [gmsh.model.getAdjacencies(1, line)[1][0] for line in lines]


def _size_field(rim: list[int], wall: list[int], track: list[int], mesh: Mesh) -> None:
    """Cell size growing from the rim, and from the tip's path, to that of the far water."""
    fields = gmsh.model.mesh.field

    def graded(kind: str, members: list[int], size: float, near: float, far: float) -> int:
        distance = fields.add("Distance")
        fields.setNumbers(distance, kind, members)
        fields.setNumber(distance, "Sampling", 2)
        threshold = fields.add("Threshold")
        fields.setNumber(threshold, "InField", distance)
        fields.setNumber(threshold, "SizeMin", size)
        fields.setNumber(threshold, "SizeMax", mesh.far_cell)
        fields.setNumber(threshold, "DistMin", near)
        fields.setNumber(threshold, "DistMax", far)
        return threshold

    reach = mesh.near_distance + 5 * mesh.far_cell
    parts = [graded("CurvesList", rim + wall, 1.1 * mesh.wall_cell, 0.002, reach)]
    parts.append(graded("PointsList", track, mesh.near_cell, mesh.near_distance, reach))
    least = fields.add("Min")
    fields.setNumbers(least, "FieldsList", parts)
    fields.setAsBackgroundMesh(least)
