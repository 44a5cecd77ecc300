"""Quality of a swept planform mesh: the measures that decide whether a finite-volume solver can use it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.geometry.planform import Planform


@dataclass(frozen=True)
class Edges:
    """Edges of a planform: end nodes (edge, 2), and the cells on the left and right (-1 outside)."""

    nodes: np.ndarray
    left: np.ndarray
    right: np.ndarray


def planform_edges(triangles: np.ndarray, quads: np.ndarray) -> Edges:
    """Unique edges of triangles (cells first) and quads, directed as the cell on their left runs."""
    pairs = [np.stack([c, np.roll(c, -1, axis=1)], -1).reshape(-1, 2) for c in (triangles, quads)]
    directed = np.vstack(pairs)
    owner = np.concatenate(
        [
            np.repeat(np.arange(len(triangles)), 3),
            len(triangles) + np.repeat(np.arange(len(quads)), 4),
        ]
    )
    key = np.sort(directed, axis=1)
    order = np.lexsort((owner, key[:, 1], key[:, 0]))
    directed, owner, key = directed[order], owner[order], key[order]
    first = np.ones(len(key), bool)
    first[1:] = (key[1:] != key[:-1]).any(1)
    start = np.flatnonzero(first)
    right = np.full(len(start), -1)
    second = start + 1
    paired = (second < len(key)) & ~np.append(first, True)[np.minimum(second, len(key))]
    right[paired] = owner[second[paired]]
    return Edges(directed[start], owner[start], right)


def neighbours(edges: Edges) -> np.ndarray:
    """Pairs (inner edge, 2) of planform cells that share an edge."""
    inner = edges.right >= 0
    return np.column_stack([edges.left[inner], edges.right[inner]])


def cell_centres(nodes: np.ndarray, triangles: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Area centroids of triangles, then quads."""
    centre3 = nodes[triangles].mean(1)
    q = nodes[quads]
    half = [_area_centroid(q[:, [0, 1, 2]]), _area_centroid(q[:, [0, 2, 3]])]
    area = half[0][0] + half[1][0]
    centre4 = (half[0][0][:, None] * half[0][1] + half[1][0][:, None] * half[1][1]) / area[:, None]
    return np.vstack([centre3, centre4])


def _area_centroid(corner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    e, f = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    return 0.5 * (e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]), corner.mean(1)


def cell_areas(nodes: np.ndarray, triangles: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Areas of triangles, then quads, m²."""
    q = nodes[quads]
    return np.concatenate(
        [
            _area_centroid(nodes[triangles])[0],
            _area_centroid(q[:, [0, 1, 2]])[0] + _area_centroid(q[:, [0, 2, 3]])[0],
        ]
    )


def face_measures(
    nodes: np.ndarray, planform: Planform, edges: Edges
) -> tuple[np.ndarray, np.ndarray]:
    """Non-orthogonality (deg) and skewness of the inner faces, as OpenFOAM's checkMesh defines them."""
    centre = cell_centres(nodes, planform.triangles, planform.quads)
    inner = edges.right >= 0
    a, b = nodes[edges.nodes[inner, 0]], nodes[edges.nodes[inner, 1]]
    own, other = centre[edges.left[inner]], centre[edges.right[inner]]
    span, edge = other - own, b - a
    normal = np.column_stack([edge[:, 1], -edge[:, 0]])
    cosine = (span * normal).sum(1) / (np.hypot(*span.T) * np.hypot(*normal.T))
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    middle = 0.5 * (a + b)
    crossing = own + span * (((middle - own) * normal).sum(1) / (span * normal).sum(1))[:, None]
    offset = np.hypot(*(middle - crossing).T)
    return angle, offset / np.maximum(0.2 * np.hypot(*span.T), 0.5 * np.hypot(*edge.T))


@dataclass(frozen=True)
class Quality:
    """The measures of one shape of a planform; `min_area_ratio` is that of a cell to its area as built; columns of mesh_quality.csv."""

    max_non_orthogonality_deg: float
    mean_non_orthogonality_deg: float
    max_skewness: float
    min_area_ratio: float


def shape_quality(planform: Planform, nodes: np.ndarray) -> Quality:
    """Quality of a planform whose nodes are at `nodes` (node, 2)."""
    edges = planform_edges(planform.triangles, planform.quads)
    angle, skewness = face_measures(nodes, planform, edges)
    cells = planform.triangles, planform.quads
    ratio = cell_areas(nodes, *cells) / cell_areas(planform.nodes, *cells)
    return Quality(
        float(angle.max()), float(angle.mean()), float(skewness.max()), float(ratio.min())
    )
