"""Structured 20-node hexahedra on a lattice, of which some elements are left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

# Nodes of a hexahedron on the lattice of half elements: corners, then middles of the edges below, above, upright.
NODES = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
NODES += [(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)]
NODES += [(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)]


def lattice_line(breaks: Sequence[float], counts: Sequence[int]) -> NDArray[np.float64]:
    """Coordinates of the corners and middles of `counts` elements between breaks."""
    parts = [
        np.linspace(a, b, 2 * n, endpoint=False)
        for a, b, n in zip(breaks[:-1], breaks[1:], counts, strict=True)
    ]
    return np.concatenate([*parts, [breaks[-1]]])


def hexahedra(kept: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Nodes (element, 20) of the `kept` elements (x, y, z), and where each node (node, 3) is on the lattice of half elements."""
    shape = tuple(2 * size + 1 for size in kept.shape)
    number = np.arange(np.prod(shape)).reshape(shape)
    ends = [
        [slice(c, c + 2 * s, 2) for c, s in zip(node, kept.shape, strict=True)] for node in NODES
    ]
    cells = np.stack([number[tuple(end)] for end in ends], -1)[kept]
    used, numbers = np.unique(cells, return_inverse=True)
    return numbers.reshape(cells.shape), np.stack(np.unravel_index(used, shape), -1)
