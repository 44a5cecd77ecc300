"""Builds the planform: quads along the finger's wall, triangles elsewhere, fixed bodies cut out."""

from itertools import pairwise

import numpy as np
import shapely
from numpy import ndarray
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


def build_planform(
    outline: ndarray,
    tip: ndarray,
    half_width: float,
    depth: float,
    mesh: Mesh,
    path: ndarray,
    mirror: bool = False,
    bodies: tuple[FixedBody, ...] = (),
) -> Planform:
    """Mesh the water around a finger's closed `outline` (point, 2), and its footprint.

    Cells stay small within `near_distance` of the points `path` (n, 2). The tank spans
    ±`half_width` and 0…`depth`; where `mirror`, its right side is the plane x = 0, on which nodes
    may slide. `bodies` are numbered from 2 in their order.
    """
    box = (-half_width, 0.0 if mirror else half_width, depth)
    tank = shapely.box(box[0], 0.0, box[1], depth).exterior
    others = _distance_to([tank, *(shapely.LinearRing(np.vstack(b.pieces)) for b in bodies)])
    own = _own_clearance(outline)

    def clearance(points: ndarray) -> ndarray:
        return np.minimum(others(points), own(points))

    ring = shapely.LinearRing(outline)
    material = wall_nodes(outline, tip, mesh, clearance)
    if not ring.is_ccw:
        material = material[::-1]
    layers = ring_layers(outline_at(outline, material), mesh, clearance)
    count = len(material)
    to_finger = _distance_to([ring])
    lines = _body_lines(bodies, to_finger, mesh)
    wall, rim = layers[0], layers[-1]
    crowded = np.vstack([wall, rim, *lines])
    near = np.tile(clearance(wall), 2), *(to_finger(line) for line in lines)
    size = GAP_CELL * np.concatenate(near)
    narrow = size < mesh.tip_cell
    crowded, size = crowded[narrow], size[narrow]
    if mesh.wall_grading:
        crowded = np.vstack([crowded, rim])
        edge = np.roll(rim, -1, axis=0) - np.roll(rim, 1, axis=0)
        size = np.append(size, np.hypot(*edge.T) / 2)
    mesh_2d = triangulate(wall, rim, box, mesh, path, lines, (crowded, size))
    # outer rim, wall, and gmsh's own nodes; then the ring's inner polygons
    nodes = np.vstack([mesh_2d.nodes, *layers[1:-1]])
    inner = len(mesh_2d.nodes) + count * np.arange(len(layers) - 2)
    rows = [first + np.arange(count) for first in (count, *inner, 0)]
    cells = [np.column_stack([a, b, np.roll(b, -1), np.roll(a, -1)]) for a, b in pairwise(rows)]
    # quads are of the water: within fixed bodies they are split
    water = np.ones(len(mesh_2d.quads), bool)
    for thing in bodies:
        water &= ~_within(thing, nodes, mesh_2d.quads)
    triangles = np.vstack([mesh_2d.triangles, halves(nodes, mesh_2d.quads[~water])])
    quads = np.vstack([*cells, mesh_2d.quads[water]])
    body = np.concatenate([mesh_2d.inside, np.zeros(len(triangles) - len(mesh_2d.inside), int)])
    for number, thing in enumerate(bodies, 2):
        body[_within(thing, nodes, triangles)] = number
    fixed = np.zeros((len(nodes), 2), bool)
    fixed[rows[0]] = fixed[mesh_2d.outer] = True
    if mirror:
        x, y = nodes[mesh_2d.outer].T
        fixed[mesh_2d.outer[(x == 0) & (y > 0) & (y < depth)], 1] = False
    fixed[mesh_2d.on_bodies] = True
    corners = (box[0], 0.0), box[1:]
    return Planform(nodes, triangles, quads, body, rows[0], material, mesh_2d.outer, fixed, corners)


def _within(body: FixedBody, nodes: ndarray, cells: ndarray) -> ndarray:
    """Whether cells (n, corner) lie in a body's footprint (n,)."""
    return np.asarray(shapely.contains_xy(body.polygon, *nodes[cells].mean(1).T))


def _own_clearance(outline: ndarray) -> Clearance:
    """Radius (m) of the largest circle that touches a closed outline from outside at points (n, 2).

    Between two walls that is half of their distance. It grows by no more than the way along the
    outline, so that cells do.
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

    def clearance(points: ndarray) -> ndarray:
        distance, nearest = tree.query(points)
        return np.asarray(radius[nearest] + distance)

    return clearance


def _distance_to(things: list[shapely.Geometry]) -> Clearance:
    """Function of points (n, 2): distance (m) to the nearest of `things`."""
    together = shapely.GeometryCollection(things)
    shapely.prepare(together)
    return lambda points: shapely.distance(together, shapely.points(points))


def _body_lines(bodies: tuple[FixedBody, ...], to_finger: Clearance, mesh: Mesh) -> list[ndarray]:
    """Nodes (node, 2) along the outline of each body; a closed one ends where it starts."""

    def size(points: ndarray) -> ndarray:
        return np.clip(GAP_CELL * to_finger(points), None, mesh.wall_cell)

    lines = []
    for body in bodies:
        first, *others = (outline_at(piece, spread(piece, size, 4)) for piece in body.pieces)
        lines.append(np.vstack([first, *(piece[1:] for piece in others)]))
    return lines


def mirrored(planform: Planform, mirrored_finger: int) -> Planform:
    """A planform and its image in x = 0 as one; `mirrored_finger`: body number of the image.

    Images of nodes off the plane follow the nodes themselves.
    """
    off = planform.nodes[:, 0] != 0
    image = np.arange(len(off))
    image[off] = len(off) + np.arange(off.sum())
    left, right = planform.outer, image[planform.outer]
    (x0, _), (_, depth) = planform.corners
    low = int(np.flatnonzero((planform.nodes[left] == [0.0, 0.0]).all(1))[0])
    high = int(np.flatnonzero((planform.nodes[left] == [0.0, depth]).all(1))[0])
    outer = np.concatenate(
        [left[: low + 1], right[:low][::-1], right[high + 1 :][::-1], left[high:]]
    )
    other = np.where(planform.body == 1, mirrored_finger, planform.body)
    return Planform(
        mirrored_shapes(planform.nodes, planform),
        np.vstack([planform.triangles, image[planform.triangles][:, ::-1]]),
        np.vstack([planform.quads, image[planform.quads][:, ::-1]]),
        np.concatenate([planform.body, other]),
        planform.wall,
        planform.material,
        outer,
        np.vstack([planform.fixed, planform.fixed[off]]),
        ((x0, 0.0), (-x0, depth)),
    )


def mirrored_shapes(shapes: ndarray, planform: Planform) -> ndarray:
    """Shapes (…, node, 2) of a planform and its image, as `mirrored` orders nodes."""
    off = planform.nodes[:, 0] != 0
    return np.concatenate([shapes, shapes[..., off, :] * np.array([-1.0, 1.0])], axis=-2)
