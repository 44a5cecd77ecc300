"""Pictures of the mesh: the planform at three shapes."""

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy import ndarray

from postprocess.draw.style import INK, MM, WIDTH, new_figure
from postprocess.words import minus

_NAMES = ("at rest", "half-way", "farthest")


def edges(cells: list[ndarray]) -> ndarray:
    """Unique edges (n, 2) of cells (n, corners), one array for each number of corners."""
    pairs = [np.stack([c, np.roll(c, -1, axis=1)], axis=-1).reshape(-1, 2) for c in cells if c.size]
    return np.unique(np.sort(np.concatenate(pairs), axis=1), axis=0)


def planform(
    shapes: list[ndarray],
    bend_deg: ndarray,
    lines: list[ndarray],
    limits: tuple[float, ...],
) -> Figure:
    """The planform (node, axis) and its edges at three shapes; limits x0, x1, y0, y1 in m."""
    figure, axes = new_figure(2 * WIDTH, 4.6, 1, len(shapes), dpi=150, sharey=True)
    for ax, points, joined, bend, name in zip(axes, shapes, lines, bend_deg, _NAMES, strict=True):
        ends = points[joined] * MM
        near = (ends.max(axis=1) > np.array(limits[::2]) * MM).all(axis=1)
        near &= (ends.min(axis=1) < np.array(limits[1::2]) * MM).all(axis=1)
        ax.add_collection(LineCollection(ends[near], colors=INK, linewidths=0.25, rasterized=True))
        low, high = np.array(limits[:2]) * MM, np.array(limits[2:]) * MM
        ax.set(xlim=low, ylim=high, aspect="equal")
        turned = f", bent by {minus(f'{bend:.0f}')}°" if np.any(bend_deg) else ""
        ax.set(xlabel="x, mm", title=f"{name}{turned}")
        ax.grid(False)
    axes[0].set_ylabel("y, mm")
    return figure
