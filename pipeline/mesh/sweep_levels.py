"""The layers of the sweep along z."""

from __future__ import annotations

import numpy as np

from pipeline.scene.pinch import Support
from pipeline.scene.sections import Mesh


def graded_layers(
    kind: str, finger_width: float, tank_width: float, mesh: Mesh, support: Support | None
) -> np.ndarray:
    """z of the sweep's levels (m), from the back wall of the tank to the sheet; even over the finger, growing beyond.

    Where a support is wanted its side is one of them.
    """
    half = 0.5 * tank_width
    if kind == "2d":
        return np.array([-finger_width, 0.0])
    on = np.linspace(0.0, 0.5 * finger_width, mesh.layers_on_finger + 1)
    beyond = on[-1] + _growing(half - on[-1], on[1], mesh.layers_beyond)
    if support is not None:
        on, beyond = _with_level(on, beyond, 0.5 * support.size[2])
    back = -np.concatenate([on, beyond])[::-1]
    return back if kind in ("half", "quarter") else np.concatenate([back, -back[-2::-1]])


def _growing(span: float, first: float, count: int) -> np.ndarray:
    """`count` cumulated steps that grow geometrically from about `first` and fill `span`."""
    low, high = 1.0, 5.0
    for _ in range(80):
        ratio = 0.5 * (low + high)
        low, high = (
            (ratio, high) if first * sum(ratio**k for k in range(1, count + 1)) < span else (low, ratio)
        )
    steps = np.cumsum(ratio ** np.arange(1, count + 1))
    return span * steps / steps[-1]


def _with_level(on: np.ndarray, beyond: np.ndarray, z: float) -> tuple[np.ndarray, np.ndarray]:
    """Levels with one at `z`: the nearest that may move is moved there, else one is added."""
    levels = np.concatenate([on, beyond])
    if np.abs(levels - z).min() < 1e-9:
        return on, beyond
    part, free = (on, slice(1, -1)) if z < on[-1] else (beyond, slice(0, -1))
    if part[free].size:
        part = part.copy()
        part[free][np.argmin(np.abs(part[free] - z))] = z
    else:
        part = np.sort(np.append(part, z))
    return (part, beyond) if z < on[-1] else (on, part)
