"""Pictures of the mesh: the planform at three shapes, and a view in space."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from postprocess.style import CFD, MM, new_figure, save

NAMES = ("start", "middle", "end")


def edges(cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Unique edges (n, 2) of a flat connectivity with VTK-like offsets (cell + 1); ValueError where they do not fit."""
    if offsets[0] != 0 or offsets[-1] != cells.size:
        raise ValueError("planform.h5: offsets must begin with 0 and end with the length of cells")
    sizes = np.diff(offsets)
    following = np.arange(1, cells.size + 1)
    following[offsets[1:] - 1] = offsets[:-1]  # the last node of a cell is joined to its first
    if np.any(sizes < 3):
        raise ValueError("planform.h5: a cell has fewer than three nodes")
    return np.unique(np.sort(np.stack([cells, cells[following]], axis=1), axis=1), axis=0)


def planform(shapes: np.ndarray, cells: np.ndarray, offsets: np.ndarray, limits: tuple[float, ...]) -> Figure:
    """The planform around the finger at its first, middle and last shape; limits are x from, x to, y from, y to (m)."""
    lines = edges(cells, offsets)
    figure, axes = new_figure(12.0, 4.3, 1, len(shapes), dpi=150, sharey=True)
    for ax, points, name in zip(axes, shapes, NAMES, strict=True):
        ends = points[lines] * MM
        near = (ends.max(axis=1) > np.array(limits[::2]) * MM).all(axis=1)
        near &= (ends.min(axis=1) < np.array(limits[1::2]) * MM).all(axis=1)
        ax.add_collection(LineCollection(ends[near], colors="#27405c", linewidths=0.25, rasterized=True))
        ax.set(xlim=(limits[0] * MM, limits[1] * MM), ylim=(limits[2] * MM, limits[3] * MM), aspect="equal")
        ax.set(xlabel="x, mm", title=f"{name} of the stroke")
        ax.grid(False)
    axes[0].set_ylabel("y, mm")
    return figure


def view_in_space(source: Path, target: Path) -> str:
    """Write the view in space to `target` (PNG); returns "pyvista" or "matplotlib", whichever drew it.

    pyvista runs in a process of its own: without a GL library it may end the whole process, not just raise.
    `source` is the .npz that figures.py writes: points, lines, outline, width, tank.
    """
    part = target.with_name(target.stem + ".part.png")
    command = [sys.executable, "-m", "postprocess.view3d", str(source.resolve()), str(part.resolve())]
    try:
        done = subprocess.run(command, capture_output=True, timeout=90, cwd=Path(__file__).parents[1])
    except subprocess.TimeoutExpired:
        done = None
    if done is not None and done.returncode == 0 and part.exists():
        os.replace(part, target)
        return "pyvista"
    save(matplotlib_view(**np.load(source)), target)
    return "matplotlib"


def matplotlib_view(points: np.ndarray, lines: np.ndarray, outline: np.ndarray, width: float, tank: np.ndarray) -> Figure:
    """The same view without any GL library: tank edges, planform on the sheet, and the finger as a prism."""
    figure, ax = new_figure(8.0, 5.4, dpi=130, subplot_kw={"projection": "3d"})
    length, height, depth = tank * MM
    corners = np.array([[x, z, y] for x in (-length / 2, length / 2) for z in (-depth / 2, depth / 2) for y in (0, height)])
    joined = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.sum(corners[a] != corners[b]) == 1]
    ax.add_collection3d(Line3DCollection([corners[[a, b]] for a, b in joined], colors="#8793a1", linewidths=1))
    sheet = np.zeros((*lines.shape, 3))
    sheet[..., [0, 2]] = points[lines] * MM
    ax.add_collection3d(Line3DCollection(sheet, colors=CFD, linewidths=0.15))
    ring = np.zeros((2, len(outline), 3))
    ring[..., [0, 2]] = outline * MM
    ring[0, :, 1], ring[1, :, 1] = -width / 2 * MM, width / 2 * MM
    after = np.roll(ring, -1, axis=1)
    sides = np.stack([ring[0], after[0], after[1], ring[1]], axis=1)
    ax.add_collection3d(Poly3DCollection([*sides, *ring], facecolor="#30343b", edgecolor="none"))
    ax.set(xlim=(-length / 2, length / 2), ylim=(-depth / 2, depth / 2), zlim=(0, height))
    ax.set(xlabel="x, mm", ylabel="z, mm", zlabel="y, mm")
    ax.set_box_aspect((length, depth, height))
    ax.view_init(elev=18, azim=-62)
    return figure
