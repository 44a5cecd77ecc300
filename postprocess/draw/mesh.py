"""Pictures of the mesh: the planform at three shapes, and a view in space."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from postprocess.draw.style import CFD, MM, new_figure

_NAMES = ("start", "middle", "end")


def edges(cells: list[np.ndarray]) -> np.ndarray:
    """Unique edges (n, 2) of cells (n, corners), one array for each number of corners."""
    pairs = [np.stack([c, np.roll(c, -1, axis=1)], axis=-1).reshape(-1, 2) for c in cells if c.size]
    return np.unique(np.sort(np.concatenate(pairs), axis=1), axis=0)


def planform(
    shapes: list[np.ndarray],
    bend_deg: np.ndarray,
    lines: list[np.ndarray],
    limits: tuple[float, ...],
) -> Figure:
    """The planform (node, axis) and its edges at three shapes; limits x0, x1, y0, y1 in m."""
    figure, axes = new_figure(12.0, 4.3, 1, len(shapes), dpi=150, sharey=True)
    for ax, points, joined, bend, name in zip(axes, shapes, lines, bend_deg, _NAMES, strict=True):
        ends = points[joined] * MM
        near = (ends.max(axis=1) > np.array(limits[::2]) * MM).all(axis=1)
        near &= (ends.min(axis=1) < np.array(limits[1::2]) * MM).all(axis=1)
        ax.add_collection(
            LineCollection(ends[near], colors="#27405c", linewidths=0.25, rasterized=True)
        )
        low, high = np.array(limits[:2]) * MM, np.array(limits[2:]) * MM
        ax.set(xlim=low, ylim=high, aspect="equal")
        ax.set(xlabel="x, mm", title=f"{name}, bent by {bend:.0f}°" if np.any(bend_deg) else name)
        ax.grid(False)
    axes[0].set_ylabel("y, mm")
    return figure


def view_in_space(
    points: np.ndarray, lines: np.ndarray, outline: np.ndarray, width: float, tank: np.ndarray
) -> Figure:
    """Tank edges, planform on the sheet, and each finger (finger, point, axis) as a prism; m."""
    figure, ax = new_figure(
        8.0, 5.4, dpi=130, subplot_kw={"projection": "3d", "autoscale_on": False}
    )
    length, height, depth = tank * MM
    ends = (-length / 2, length / 2), (-depth / 2, depth / 2), (0, height)
    corners = np.array(list(product(*ends)))
    box = [pair for pair in combinations(corners, 2) if np.count_nonzero(pair[0] != pair[1]) == 1]
    ax.add_collection3d(Line3DCollection(box, colors="#8793a1", linewidths=1))
    sheet = np.zeros((*lines.shape, 3))
    sheet[..., [0, 2]] = points[lines] * MM
    ax.add_collection3d(Line3DCollection(sheet, colors=CFD, linewidths=0.15))
    for body in outline:
        ring = np.zeros((2, len(body), 3))
        ring[..., [0, 2]] = body * MM
        ring[0, :, 1], ring[1, :, 1] = -width / 2 * MM, width / 2 * MM
        after = np.roll(ring, -1, axis=1)
        sides = np.stack([ring[0], after[0], after[1], ring[1]], axis=1)
        body_walls = Poly3DCollection([*sides, *ring], facecolor="#30343b", edgecolor="none")
        ax.add_collection3d(body_walls)
    ax.set(**dict(zip(("xlim", "ylim", "zlim"), ends, strict=True)))
    ax.set(xlabel="x, mm", ylabel="z, mm", zlabel="y, mm")
    ax.set_box_aspect((length, depth, height), zoom=1.2)
    ax.view_init(elev=18, azim=-62)
    return figure
