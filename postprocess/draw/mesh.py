"""Pictures of the mesh: the planform at three shapes, and a view in space."""

from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from fileio.atomic import write_bytes
from postprocess.draw.style import CFD, MM, new_figure, save

NAMES = ("start", "middle", "end")
VIEW_MODULE = "postprocess.draw.view3d"
PNG = b"\x89PNG"


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
    """The planform (node, axis) and its edges at three shapes around the body; limits are x from, x to, y from, y to (m)."""
    figure, axes = new_figure(12.0, 4.3, 1, len(shapes), dpi=150, sharey=True)
    for ax, points, joined, bend, name in zip(axes, shapes, lines, bend_deg, NAMES, strict=True):
        ends = points[joined] * MM
        near = (ends.max(axis=1) > np.array(limits[::2]) * MM).all(axis=1)
        near &= (ends.min(axis=1) < np.array(limits[1::2]) * MM).all(axis=1)
        ax.add_collection(
            LineCollection(ends[near], colors="#27405c", linewidths=0.25, rasterized=True)
        )
        ax.set(
            xlim=(limits[0] * MM, limits[1] * MM),
            ylim=(limits[2] * MM, limits[3] * MM),
            aspect="equal",
        )
        ax.set(xlabel="x, mm", title=f"{name}, bent by {bend:.0f}°" if np.any(bend_deg) else name)
        ax.grid(False)
    axes[0].set_ylabel("y, mm")
    return figure


def view_in_space(target: Path, **view: Any) -> str:
    """Write the view in space to `target` (PNG); returns "pyvista" or "matplotlib", whichever drew it.

    pyvista runs in a process of its own: without a GL library it may end the whole process, not just raise.
    `view`: the arguments of `matplotlib_view`, which go to the other process as an .npz on its input.
    """
    content = io.BytesIO()
    np.savez(content, **view)
    try:
        done = subprocess.run(
            [sys.executable, "-m", VIEW_MODULE],
            input=content.getvalue(),
            capture_output=True,
            timeout=90,
            cwd=Path(__file__).parents[2],
        )
    except subprocess.TimeoutExpired:
        done = None
    if done is not None and done.returncode == 0 and done.stdout.startswith(PNG):
        write_bytes(target, done.stdout)
        return "pyvista"
    save(matplotlib_view(**view), target)
    return "matplotlib"


def matplotlib_view(
    points: np.ndarray, lines: np.ndarray, outline: np.ndarray, width: float, tank: np.ndarray
) -> Figure:
    """The same view without any GL library: tank edges, planform on the sheet, and every finger (finger, point, axis) as a prism."""
    figure, ax = new_figure(8.0, 5.4, dpi=130, subplot_kw={"projection": "3d"})
    length, height, depth = tank * MM
    corners = np.array(
        [
            [x, z, y]
            for x in (-length / 2, length / 2)
            for z in (-depth / 2, depth / 2)
            for y in (0, height)
        ]
    )
    joined = [
        (a, b) for a in range(8) for b in range(a + 1, 8) if np.sum(corners[a] != corners[b]) == 1
    ]
    ax.add_collection3d(
        Line3DCollection([corners[[a, b]] for a, b in joined], colors="#8793a1", linewidths=1)
    )
    sheet = np.zeros((*lines.shape, 3))
    sheet[..., [0, 2]] = points[lines] * MM
    ax.add_collection3d(Line3DCollection(sheet, colors=CFD, linewidths=0.15))
    for body in outline:
        ring = np.zeros((2, len(body), 3))
        ring[..., [0, 2]] = body * MM
        ring[0, :, 1], ring[1, :, 1] = -width / 2 * MM, width / 2 * MM
        after = np.roll(ring, -1, axis=1)
        sides = np.stack([ring[0], after[0], after[1], ring[1]], axis=1)
        ax.add_collection3d(
            Poly3DCollection([*sides, *ring], facecolor="#30343b", edgecolor="none")
        )
    ax.set(xlim=(-length / 2, length / 2), ylim=(-depth / 2, depth / 2), zlim=(0, height))
    ax.set(xlabel="x, mm", ylabel="z, mm", zlabel="y, mm")
    ax.set_box_aspect((length, depth, height))
    ax.view_init(elev=18, azim=-62)
    return figure
