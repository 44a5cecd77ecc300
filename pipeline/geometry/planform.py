"""The planform: a 2-D mesh of tank, finger and fixed bodies that is swept along z."""

from dataclasses import dataclass

from numpy import ndarray


@dataclass(frozen=True)
class Planform:
    """Nodes (node, 2) in m, triangles and quads as node indices, and where the boundaries are."""

    nodes: ndarray
    triangles: ndarray
    quads: ndarray
    body: ndarray  # (triangle,) in whose footprint it lies: 0 in the water, 1 in the finger
    wall: ndarray  # nodes of the finger's outline, counter-clockwise
    material: ndarray  # fractional point index along the outline of each node of `wall`
    outer: ndarray  # nodes of the tank's outline, counter-clockwise from the lower left
    fixed: ndarray  # (node, 2) True for coordinates that are prescribed when the finger moves
    corners: tuple[tuple[float, float], tuple[float, float]] = ((0, 0), (0, 0))
