"""The view in space by pyvista, in a process of its own: an .npz on its input, a PNG on its output."""

from __future__ import annotations

import io
import sys

import numpy as np
from PIL import Image


def draw(
    points: np.ndarray, lines: np.ndarray, outline: np.ndarray, width: float, tank: np.ndarray
) -> np.ndarray:
    """Tank edges, deformed planform on the sheet and every finger (finger, point, axis) as a solid, as (row, column, RGB) bytes; all lengths in m."""
    import pyvista

    flat = np.c_[points, np.zeros(len(points))]
    sheet = pyvista.PolyData(flat, lines=np.c_[np.full(len(lines), 2), lines].ravel())
    box = pyvista.Box((-tank[0] / 2, tank[0] / 2, 0, tank[1], -tank[2] / 2, tank[2] / 2)).outline()
    plotter = pyvista.Plotter(off_screen=True, window_size=[1400, 900])
    plotter.set_background("white")  # type: ignore[arg-type]
    plotter.add_mesh(box, color="#8793a1", line_width=2)
    plotter.add_mesh(sheet, color="#0b5fa5", line_width=1, opacity=0.45)
    for body in outline:
        ring = np.c_[body, np.full(len(body), -width / 2)]
        face = pyvista.PolyData(ring, faces=np.r_[len(ring), np.arange(len(ring))]).triangulate()
        plotter.add_mesh(
            face.extrude((0, 0, width), capping=True), color="#30343b", smooth_shading=False
        )
    middle = outline.mean(axis=(0, 1))
    plotter.camera.position = (middle[0] + 0.35, middle[1] + 0.22, 0.62)
    plotter.camera.focal_point = (middle[0], middle[1] - 0.03, 0)
    plotter.camera.up = (0, 1, 0)
    return np.asarray(plotter.screenshot())


if __name__ == "__main__":
    with np.load(io.BytesIO(sys.stdin.buffer.read())) as data:
        Image.fromarray(draw(**data)).save(sys.stdout.buffer, "PNG")
