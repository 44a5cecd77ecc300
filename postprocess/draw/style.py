"""How every picture looks: one set of sizes and colours, and saving whole files."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from fileio.atomic import write_bytes

CFD, PIV, THIRD, GREY = "#0b5fa5", "#c8501e", "#3f7d4e", "#5f6670"
COLOURS = {"cfd": CFD, "piv": PIV}
NAMES = {"cfd": "CFD", "piv": "PIV"}
MM = 1e3

RC: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e6ea",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "lines.linewidth": 1.8,
    "legend.frameon": False,
    "svg.fonttype": "path",
    "svg.hashsalt": "softfinger",  # equal pictures give equal files
}
# not a context around drawing: titles and labels take their style when they are set
mpl.rcParams.update(RC)  # type: ignore[arg-type]


def new_figure(
    width: float, height: float, rows: int = 1, columns: int = 1, dpi: float = 110, **more
):
    """An off-screen figure (inches) and its axes; no display and no global state of pyplot."""
    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, **more)


def label_points(axis: Axes, points: list[tuple[float, float]], names: list[str]) -> None:
    """Name points (data coordinates) where the names cover neither each other nor a point; call it when limits are set."""
    figure = axis.figure
    figure.canvas.draw()
    size, at = 8.0, axis.transData.transform(np.array(points)) if points else np.empty((0, 2))
    px, right = figure.dpi / 72, axis.bbox.x1
    taken = [(x - 3 * px, y - 3 * px, x + 3 * px, y + 3 * px) for x, y in at]
    for (x, y), point, name in zip(at, points, names, strict=True):
        width, height = 0.62 * size * len(name) * px, 1.15 * size * px
        sides = [(4 * px, 0.0), (-4 * px - width, 0.0)]
        tries = [
            (dx, dy * height)
            for dy in (0.3, -1.0, 1.2, -2.0, 2.2, -3.0, 3.2, -4.0, 4.2)
            for dx, _ in sides
        ]
        boxes = [(x + dx, y + dy, x + dx + width, y + dy + height) for dx, dy in tries]
        box = next(
            (b for b in boxes if b[2] < right and not any(_overlap(b, other) for other in taken)),
            boxes[0],
        )
        taken.append(box)
        off = ((box[0] - x) / px, (box[1] - y) / px)
        far = abs(off[1]) > 1.5 * size
        line: dict[str, Any] = (
            {"arrowprops": {"arrowstyle": "-", "color": GREY, "lw": 0.6}} if far else {}
        )
        axis.annotate(name, point, xytext=off, textcoords="offset points", fontsize=size, **line)


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def save(figure: Figure, path: Path, **more) -> Path:
    """Write a figure in the format of its suffix, whole or not at all."""
    metadata = {"Date": None} if path.suffix == ".svg" else {}
    content = io.BytesIO()
    figure.savefig(content, format=path.suffix[1:], metadata=metadata, facecolor="white", **more)
    write_bytes(path, content.getbuffer())
    return path
