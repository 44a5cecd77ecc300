"""The planform: a 2-D mesh of tank, finger and fixed bodies that is swept along z."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Planform:
    """Nodes (node, 2) in m, triangles and quads as node indices, and where the boundaries are."""

    nodes: np.ndarray
    triangles: np.ndarray
    quads: np.ndarray
    body: np.ndarray  # (triangle,) in whose footprint it lies: 0 in the water, 1 in the finger
    wall: np.ndarray  # nodes of the finger's outline, counter-clockwise
    material: np.ndarray  # fractional point index along the outline of each node of `wall`
    outer: np.ndarray  # nodes of the tank's outline, counter-clockwise from the lower left
    fixed: np.ndarray  # (node, 2) True for coordinates that are prescribed when the finger moves
    corners: tuple[tuple[float, float], tuple[float, float]] = ((0, 0), (0, 0))
