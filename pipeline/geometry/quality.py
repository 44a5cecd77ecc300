"""Quality of a planform: whether a finite-volume solver can use the swept mesh."""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from pipeline.geometry.planform import Planform


@dataclass(frozen=True)
class Edges:
    """Edges of a planform: end nodes (edge, 2), and the cells left and right (-1 outside)."""

    nodes: ndarray
    left: ndarray
    right: ndarray


def planform_edges(triangles: ndarray, quads: ndarray) -> Edges:
    """Unique edges of triangles, then quads, directed as the cell on their left runs."""
    pairs = [np.stack([c, np.roll(c, -1, axis=1)], -1).reshape(-1, 2) for c in (triangles, quads)]
    directed = np.vstack(pairs)
    owner = np.repeat(
        np.arange(len(triangles) + len(quads)), np.repeat([3, 4], [len(triangles), len(quads)])
    )
    key = np.sort(directed, axis=1)
    order = np.lexsort((owner, key[:, 1], key[:, 0]))
    directed, owner, key = directed[order], owner[order], key[order]
    same = (key[1:] == key[:-1]).all(1)  # as the edge before: the second of a pair
    start = np.flatnonzero(np.append(True, ~same))
    paired = np.append(same, False)[start]
    right = np.where(paired, owner[np.minimum(start + 1, len(owner) - 1)], -1)
    return Edges(directed[start], owner[start], right)


def neighbours(edges: Edges) -> ndarray:
    """Pairs (inner edge, 2) of planform cells that share an edge."""
    inner = edges.right >= 0
    return np.column_stack([edges.left[inner], edges.right[inner]])


def cell_centres(nodes: ndarray, triangles: ndarray, quads: ndarray) -> ndarray:
    """Area centroids of triangles, then quads."""
    (a, first), (b, second) = _halves(nodes, quads)
    middle = (a[:, None] * first + b[:, None] * second) / (a + b)[:, None]
    return np.vstack([nodes[triangles].mean(1), middle])


def cell_areas(nodes: ndarray, triangles: ndarray, quads: ndarray) -> ndarray:
    """Areas of triangles, then quads, m²."""
    (a, _), (b, _) = _halves(nodes, quads)
    return np.concatenate([_area_centroid(nodes[triangles])[0], a + b])


def _halves(nodes: ndarray, quads: ndarray) -> list[tuple[ndarray, ndarray]]:
    """Areas and centroids of the two triangles of each quad."""
    return [_area_centroid(nodes[quads[:, corners]]) for corners in ([0, 1, 2], [0, 2, 3])]


def _area_centroid(corner: ndarray) -> tuple[ndarray, ndarray]:
    e, f = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    return 0.5 * (e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]), corner.mean(1)


@dataclass(frozen=True)
class Quality:
    """Measures of one shape, columns of mesh_quality.csv; area ratio: to the cell as built."""

    max_non_orthogonality_deg: float
    mean_non_orthogonality_deg: float
    max_skewness: float
    min_area_ratio: float


def shape_quality(planform: Planform, nodes: ndarray) -> Quality:
    """Quality at `nodes` (node, 2), as OpenFOAM's checkMesh defines the measures."""
    cells = planform.triangles, planform.quads
    edges, centre = planform_edges(*cells), cell_centres(nodes, *cells)
    own, other = centre[neighbours(edges)].swapaxes(0, 1)
    a, b = nodes[edges.nodes[edges.right >= 0]].swapaxes(0, 1)
    span, edge = other - own, b - a
    normal = np.column_stack([edge[:, 1], -edge[:, 0]])
    across = (span * normal).sum(1)
    cosine = across / (np.hypot(*span.T) * np.hypot(*normal.T))
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    middle = 0.5 * (a + b)
    crossing = own + span * (((middle - own) * normal).sum(1) / across)[:, None]
    offset = np.hypot(*(middle - crossing).T)
    skewness = offset / np.maximum(0.2 * np.hypot(*span.T), 0.5 * np.hypot(*edge.T))
    ratio = cell_areas(nodes, *cells) / cell_areas(planform.nodes, *cells)
    return Quality(
        float(angle.max()), float(angle.mean()), float(skewness.max()), float(ratio.min())
    )
