"""Two fingers over time: the closing, both pairs of vortices, flow and pressure between."""

import pandas as pd
from matplotlib.figure import Figure
from numpy import ndarray

from postprocess.draw.series import Curve, over_time
from postprocess.draw.style import (
    COLOURS,
    FIRST,
    GREY,
    MM,
    NAMES,
)
from postprocess.evidence.pair_integrals import DORSAL, VENTRAL, vortex_of

_CM2 = 1e4
_TALL = 7.6  # inches: four panels


def _of(table: pd.DataFrame, column: str, factor: float, label: str, colour: str, style="-"):
    values = table[column].to_numpy(float) * factor
    return Curve(table["time"].to_numpy(), values, label, colour, style)


def closing(
    time: ndarray,
    gap: ndarray,
    free_gap: ndarray,
    integrals: dict[str, pd.DataFrame],
    lines: dict[str, pd.DataFrame],
    met: float | None,
) -> Figure:
    """Gap of a tip with the closing law and without (m over s), both pairs, streams and pressure.

    Tables by source as of pair_integrals and centreline; `met`: contact, s.
    """
    ways = ((gap, FIRST, "-", "as it closes"), (free_gap, GREY, "--", "unhindered"))
    vortices, speeds = [], []
    for source, table in integrals.items():
        name, colour = NAMES[source], COLOURS[source]
        for (side, flow), style in ((DORSAL, "-"), (VENTRAL, "--")):
            rows = vortex_of(table, side, flow, 0)
            vortices.append(_of(rows, "circulation", _CM2, f"{side}, {name}", colour, style))
        for column, word, style in (("jet_speed", "down", "-"), ("rise_speed", "up", "--")):
            speeds.append(_of(lines[source], column, 1.0, f"{word}, {name}", colour, style))
    panels = [
        ("gap between tip\nand plane, mm", [Curve(time, v * MM, n, c, s) for v, c, s, n in ways]),
        ("circulation of\nleft vortices, cm²/s", vortices),
        ("fastest flow\nbetween, m/s", speeds),
    ]
    if "pressure_gap" in lines["cfd"]:
        pressure = _of(lines["cfd"], "pressure_gap", 1.0, "", FIRST)
        panels.append(("pressure between\nthe tips, Pa", [pressure]))
    figure = over_time(panels, _TALL, met=met)
    figure.axes[0].set(yscale="log", ylim=(0.8 * gap.min() * MM, 1.2 * gap.max() * MM))
    return figure
