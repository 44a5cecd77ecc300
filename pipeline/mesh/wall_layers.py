"""The ring of quadrilaterals around the finger: nodes on its outline, and layers beyond."""

from collections.abc import Callable

import numpy as np
from numpy import ndarray

from pipeline.kinematics.shapes import arc_length
from pipeline.scene.sections import Mesh

# Shares of the width of a narrow gap: size of a cell along the walls, and height of the ring. With
# two rows of triangles in the other half, and the layers of the ring, four cells or more span it.
GAP_CELL = 0.3
_GAP_RING = 0.5

# points (n, 2) -> distance to what is near the finger (n,), m
Clearance = Callable[[ndarray], ndarray]


def outline_at(outline: ndarray, material: ndarray) -> ndarray:
    """Points (…, node, 2) of closed outlines (…, point, 2) at fractional point indices."""
    closed = np.concatenate([outline, outline[..., :1, :]], axis=-2)
    index = np.minimum(material.astype(int), outline.shape[-2] - 1)
    part = (material - index)[:, None]
    return closed[..., index, :] * (1 - part) + closed[..., index + 1, :] * part


def spread(line: ndarray, size: Callable[[ndarray], ndarray], least: int) -> ndarray:
    """Fractional point indices along an open polyline (point, 2), both ends included.

    `size` maps points (n, 2) to wanted distances (m); at least `least` intervals are made.
    """
    walk = arc_length(line)
    fine = np.linspace(0, walk[-1], 20 * (len(line) - 1) + 1)
    x, y = np.interp(fine, walk, line[:, 0]), np.interp(fine, walk, line[:, 1])
    cells = (fine[1] - fine[0]) / size(np.column_stack([x, y])[:-1])
    count_walk = np.concatenate([[0], np.cumsum(cells)])
    count = max(least, round(count_walk[-1]))
    at = np.interp(np.linspace(0, count_walk[-1], count + 1), count_walk, fine)
    return np.interp(at, walk, np.arange(len(walk)))


def wall_nodes(outline: ndarray, tip: ndarray, mesh: Mesh, clearance: Clearance) -> ndarray:
    """Fractional point indices along a closed outline.

    They are `tip_cell` apart near the tip (or tips), `wall_cell` elsewhere, less in gaps.
    """

    def size(points: ndarray) -> ndarray:
        distance = np.min([np.hypot(*(points - end).T) for end in np.atleast_2d(tip)], axis=0)
        blend = np.clip((distance - mesh.tip_distance) / mesh.tip_transition, 0, 1)
        wanted = mesh.tip_cell + (mesh.wall_cell - mesh.tip_cell) * blend
        return np.minimum(wanted, GAP_CELL * clearance(points))

    return spread(np.vstack([outline, outline[:1]]), size, 24)[:-1]


def ring_layers(wall: ndarray, mesh: Mesh, clearance: Clearance) -> list[ndarray]:
    """Closed polygons from the wall outwards, thinner where the clearance is small."""
    edge = np.roll(wall, -1, axis=0) - np.roll(wall, 1, axis=0)
    normal = np.column_stack([edge[:, 1], -edge[:, 0]])  # outwards of a counter-clockwise polygon
    normal /= np.hypot(*normal.T)[:, None]
    heights = np.cumprod([mesh.wall_first_layer, *[mesh.wall_growth] * (mesh.wall_layers - 1)])
    thin = np.minimum(1.0, _GAP_RING * clearance(wall) / heights.sum())[:, None]
    layers = [wall]
    for height in heights:
        # smoothed normals keep neighbouring spokes from crossing
        normal = normal + 0.5 * (np.roll(normal, 1, axis=0) + np.roll(normal, -1, axis=0))
        normal /= np.hypot(*normal.T)[:, None]
        layers.append(layers[-1] + height * thin * normal)
    return layers
