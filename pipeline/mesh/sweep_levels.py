"""Levels of the sweep along z, graded from the finger's side edges, which shed vortices."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy import ndarray

from pipeline.scene.sections import Mesh


def graded_layers(
    kind: str, finger_width: float, tank_width: float, mesh: Mesh, reaches: tuple[float, ...] = ()
) -> ndarray:
    """z of the levels (m), from the back wall to the sheet, or to the front wall in a full model.

    The sides of the finger, and the `reaches` in |z| of fixed bodies, are levels.
    """
    if kind == "2d":
        return np.array([-finger_width, 0.0])
    edge = 0.5 * finger_width
    # layers grow by a constant factor where their thickness is linear in the distance
    slope = np.log(mesh.layer_growth)
    first = mesh.edge_layer * slope / (mesh.layer_growth - 1)

    def thickness(z: ndarray) -> ndarray:
        wanted = first + slope * np.abs(z - edge)
        return np.where(z < edge, np.minimum(wanted, mesh.sheet_layer), wanted)

    ends = {0.0, edge, 0.5 * tank_width, *reaches}
    parts = [divided(a, b, thickness) for a, b in pairwise(sorted(ends))]
    back = -np.concatenate([[0.0], *parts])[::-1]
    return back if kind in ("half", "quarter") else np.concatenate([back, -back[-2::-1]])


def divided(start: float, end: float, thickness: Callable[[ndarray], ndarray]) -> ndarray:
    """Ends (n,) of the fewest intervals from start to end, none longer than `thickness` there."""
    fine = np.linspace(start, end, 4001)
    steps = np.diff(fine) / thickness(0.5 * (fine[1:] + fine[:-1]))
    walk = np.concatenate([[0.0], np.cumsum(steps)])
    count = max(1, int(np.ceil(walk[-1] - 1e-6)))
    return np.interp(walk[-1] * np.arange(1, count + 1) / count, walk, fine)
