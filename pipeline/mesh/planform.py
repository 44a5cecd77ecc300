"""The planform: a 2-D mesh of tank, finger and fixed bodies, quads along the finger's wall and triangles elsewhere."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely
from scipy.spatial import KDTree

from pipeline.geometry.planform import Planform
from pipeline.mesh.fixed_bodies import FixedBody
from pipeline.mesh.triangulate import halves, triangulate
from pipeline.mesh.wall_layers import (
    GAP_CELL,
    Clearance,
    outline_at,
    ring_layers,
    spread,
    wall_nodes,
)
from pipeline.scene.sections import Mesh


def build_planform(outline: np.ndarray, tip: np.ndarray, half_width: float, depth: float, mesh: Mesh,
                   path: np.ndarray, mirror: bool = False, bodies: tuple[FixedBody, ...] = ()) -> Planform:  # fmt: skip
    """Mesh the water around (and the footprint of) a finger given by its closed `outline` (point, 2).

    `path` (n, 2) holds points that the tip passes: cells stay small within `near_distance` of them. The tank spans
    ±`half_width` and 0…`depth`; where `mirror`, its right side is the plane x = 0, on which nodes may slide. `bodies`
    are numbered from 2 in their order.
    """
    box = (-half_width, 0.0 if mirror else half_width, depth)
    tank = shapely.box(box[0], 0.0, box[1], depth).exterior
    others = distance_to([tank, *(shapely.LinearRing(np.vstack(body.pieces)) for body in bodies)])
    own = own_clearance(outline)

    def clearance(points: np.ndarray) -> np.ndarray:
        return np.minimum(others(points), own(points))

    area = 0.5 * np.sum(
        outline[:, 0] * np.roll(outline[:, 1], -1) - np.roll(outline[:, 0], -1) * outline[:, 1]
    )
    material = wall_nodes(outline, tip, mesh, clearance)
    if area < 0:
        material = material[::-1]
    layers = ring_layers(outline_at(outline, material), mesh, clearance)
    count = len(material)
    to_finger = distance_to([shapely.LinearRing(outline)])
    lines = _body_lines(bodies, to_finger, mesh)
    crowded = np.vstack([layers[0], layers[-1], *lines])
    size = GAP_CELL * np.concatenate(
        [np.tile(clearance(layers[0]), 2), *(to_finger(line) for line in lines)]
    )
    narrow = size < mesh.tip_cell
    if mesh.wall_grading:
        rim = layers[-1]
        crowded = np.vstack([crowded, rim])
        size = np.append(
            size, np.hypot(*(np.roll(rim, -1, axis=0) - np.roll(rim, 1, axis=0)).T) / 2
        )
        narrow = np.append(narrow, np.ones(len(rim), bool))
    mesh_2d = triangulate(
        layers[0], layers[-1], box, mesh, path, lines, (crowded[narrow], size[narrow])
    )
    # gmsh numbers: outer rim first, then the wall, then its own; put the ring's inner polygons behind them
    middle = np.vstack(layers[1:-1]) if len(layers) > 2 else np.empty((0, 2))
    first_middle = len(mesh_2d.nodes)
    nodes = np.vstack([mesh_2d.nodes, middle])
    row = [np.arange(count) + count]
    row += [first_middle + k * count + np.arange(count) for k in range(len(layers) - 2)]
    row += [np.arange(count)]
    ring = [np.column_stack([a, b, np.roll(b, -1), np.roll(a, -1)]) for a, b in pairwise(row)]
    # quads are of the water: within fixed bodies they are split
    water = np.ones(len(mesh_2d.quads), bool)
    for thing in bodies:
        water &= ~within(thing, nodes, mesh_2d.quads)
    triangles = np.vstack([mesh_2d.triangles, halves(nodes, mesh_2d.quads[~water])])
    quads = np.vstack([*ring, mesh_2d.quads[water]])
    body = np.concatenate([mesh_2d.inside, np.zeros(len(triangles) - len(mesh_2d.inside), int)])
    for number, thing in enumerate(bodies, 2):
        body[within(thing, nodes, triangles)] = number
    fixed = np.zeros((len(nodes), 2), bool)
    fixed[row[0]] = fixed[mesh_2d.outer] = True
    if mirror:
        x, y = nodes[mesh_2d.outer].T
        fixed[mesh_2d.outer[(x == 0) & (y > 0) & (y < depth)], 1] = False
    fixed[mesh_2d.on_bodies] = True
    return Planform(
        nodes,
        triangles,
        quads,
        body,
        row[0],
        material,
        mesh_2d.outer,
        fixed,
        ((box[0], 0.0), box[1:]),
    )


def within(body: FixedBody, nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Whether cells (n, corner) lie in a body's footprint (n,)."""
    return np.asarray(shapely.contains_xy(body.polygon, *nodes[cells].mean(1).T))


def own_clearance(outline: np.ndarray) -> Clearance:
    """Function of points (n, 2) at a closed outline: radius (m) of the largest circle that touches it there from outside.

    Between two walls that is half of their distance. Along the outline it grows by no more than the way, so that cells do.
    """
    edge = np.roll(outline, -1, axis=0) - np.roll(outline, 1, axis=0)
    normal = np.column_stack([edge[:, 1], -edge[:, 0]]) / np.hypot(*edge.T)[:, None]
    normal *= 1.0 if shapely.LinearRing(outline).is_ccw else -1.0
    apart = outline[None] - outline[:, None]
    square = (apart**2).sum(-1)
    ahead = np.maximum(np.einsum("pqk,pk->pq", apart, normal), 1e-12)
    radius = np.divide(square, 2 * ahead, out=np.full_like(square, np.inf), where=square > 0).min(1)
    sides = np.hypot(*(np.roll(outline, -1, axis=0) - outline).T)
    way = np.abs(np.subtract.outer(np.cumsum(sides), np.cumsum(sides)))
    radius = (radius[None] + np.minimum(way, sides.sum() - way)).min(1)
    tree = KDTree(outline)

    def clearance(points: np.ndarray) -> np.ndarray:
        distance, nearest = tree.query(points)
        return np.asarray(radius[nearest] + distance)

    return clearance


def distance_to(things: list[shapely.Geometry]) -> Clearance:
    """Function of points (n, 2): distance (m) to the nearest of `things`."""
    together = shapely.GeometryCollection(things)
    shapely.prepare(together)
    return lambda points: shapely.distance(together, shapely.points(points))


def _body_lines(
    bodies: tuple[FixedBody, ...], to_finger: Clearance, mesh: Mesh
) -> list[np.ndarray]:
    """Nodes (node, 2) along the outline of each body; a closed one ends where it starts."""

    def size(points: np.ndarray) -> np.ndarray:
        return np.clip(GAP_CELL * to_finger(points), None, mesh.wall_cell)

    lines = []
    for body in bodies:
        pieces = [outline_at(piece, spread(piece, size, 4)) for piece in body.pieces]
        lines.append(np.vstack([pieces[0], *(piece[1:] for piece in pieces[1:])]))
    return lines


def mirror_nodes(nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For a planform whose right side is x = 0: nodes (…, node, 2) off that plane, and each node's image (node,).

    Images of nodes off the plane follow the nodes themselves, in their order.
    """
    off = np.flatnonzero(nodes[:, 0] != 0)
    image = np.arange(len(nodes))
    image[off] = len(nodes) + np.arange(len(off))
    return off, image


def mirrored(planform: Planform, mirrored_finger: int) -> Planform:
    """A planform and its image in x = 0 as one; the image of the finger's footprint has a body number of its own."""
    off, image = mirror_nodes(planform.nodes)
    flip = np.array([-1.0, 1.0])
    left, right = planform.outer, image[planform.outer]
    (x0, _), (_, depth) = planform.corners
    low = int(np.flatnonzero((planform.nodes[left] == [0.0, 0.0]).all(1))[0])
    high = int(np.flatnonzero((planform.nodes[left] == [0.0, depth]).all(1))[0])
    outer = np.concatenate(
        [left[: low + 1], right[:low][::-1], right[high + 1 :][::-1], left[high:]]
    )
    other = np.where(planform.body == 1, mirrored_finger, planform.body)
    fixed = np.vstack([planform.fixed, planform.fixed[off]])
    return Planform(
        np.vstack([planform.nodes, planform.nodes[off] * flip]),
        np.vstack([planform.triangles, image[planform.triangles][:, ::-1]]),
        np.vstack([planform.quads, image[planform.quads][:, ::-1]]),
        np.concatenate([planform.body, other]),
        planform.wall,
        planform.material,
        outer,
        fixed,
        ((x0, 0.0), (-x0, depth)),
    )


def mirrored_shapes(shapes: np.ndarray, planform: Planform) -> np.ndarray:
    """Shapes (…, node, 2) of a planform, with those of its image added as `mirrored` orders nodes."""
    off, _ = mirror_nodes(planform.nodes)
    return np.concatenate([shapes, shapes[..., off, :] * np.array([-1.0, 1.0])], axis=-2)
