"""The trade-off of a study's runs as a figure: error over CPU time."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from postprocess.draw.style import CFD, GREY, PIV, new_figure

_LETTER = 8.0  # points


def error_over_cost(table: pd.DataFrame) -> Figure:
    """Error against CPU time, of the flow and of PIV where it was run; a line joins the front."""
    known = table[table["error"].notna()]
    panels = [
        panel
        for panel in (
            ("flow", "Flow", "cpu_flow_s", "CPU time of the flow, s", CFD),
            ("piv", "PIV", "cpu_piv_per_field_s", "CPU time of a field, s", PIV),
        )
        if (known["kind"] == panel[0]).any()
    ]
    figure, axes = new_figure(5.5 * len(panels), 4.6, 1, len(panels))
    for axis, (kind, title, cost, label, colour) in zip(np.atleast_1d(axes), panels, strict=True):
        axis.set(xscale="log", yscale="log", xlabel=label, ylabel="worst error, %", title=title)
        _panel(axis, known[known["kind"] == kind], cost, colour)
    return figure


def _panel(axis: Axes, rows: pd.DataFrame, cost: str, colour: str) -> None:
    rows = rows.assign(percent=100 * rows["error"])
    ahead = rows[rows["front"]].sort_values(cost)
    axis.plot(ahead[cost], ahead["percent"], color=colour, lw=1.2, zorder=1)
    colours = [colour if f else GREY for f in rows["front"]]
    axis.scatter(rows[cost], rows["percent"], c=colours, s=28, zorder=2)
    for side in (axis.xaxis, axis.yaxis):
        side.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        side.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        side.set_minor_formatter(NullFormatter())
    axis.margins(x=0.2, y=0.1)
    points = rows[[cost, "percent"]].to_numpy(float)
    label_points(axis, points, [str(run).removeprefix("piv_") for run in rows["run"]])


def label_points(axis: Axes, points: np.ndarray, names: list[str]) -> None:
    """Name points (n, 2) of an axis with its limits set, so that no name covers another."""
    figure = axis.figure
    figure.canvas.draw()
    px, right, at = figure.dpi / 72, axis.bbox.x1, axis.transData.transform(points)
    taken = [(x - 3 * px, y - 3 * px, x + 3 * px, y + 3 * px) for x, y in at]
    for (x, y), point, name in zip(at, points, names, strict=True):
        width, height = 0.62 * _LETTER * len(name) * px, 1.15 * _LETTER * px
        places = [
            (x + dx, y + dy * height)
            for dy in (0.3, -1.0, 1.2, -2.0, 2.2, -3.0, 3.2, -4.0, 4.2)
            for dx in (4 * px, -4 * px - width)
        ]
        boxes = [(left, low, left + width, low + height) for left, low in places]
        free = (b for b in boxes if b[2] < right and not any(_overlap(b, o) for o in taken))
        box = next(free, boxes[0])
        taken.append(box)
        off = ((box[0] - x) / px, (box[1] - y) / px)
        line: dict[str, Any] = {"arrowstyle": "-", "color": GREY, "lw": 0.6}
        axis.annotate(
            name, point, xytext=off, textcoords="offset points", fontsize=_LETTER,
            arrowprops=line if abs(off[1]) > 1.5 * _LETTER else None,
        )  # fmt: skip


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
