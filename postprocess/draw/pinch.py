"""Two fingers over time: the closing, both pairs of vortices, and the single finger beside."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from postprocess.draw.series import Curve, over_time
from postprocess.draw.style import (
    COLOURS,
    FIRST,
    GREY,
    HEIGHT,
    MM,
    NAMES,
    SECOND,
    THIRD,
    WIDTH,
    new_figure,
)
from postprocess.evidence.pair_integrals import DORSAL, VENTRAL, vortex_of

_CM2 = 1e4
_TALL = 7.6  # inches: four panels


def _of(table: pd.DataFrame, column: str, factor: float, label: str, colour: str, style="-"):
    values = table[column].to_numpy(float) * factor
    return Curve(table["time"].to_numpy(), values, label, colour, style)


def closing(
    time: np.ndarray,
    gap: np.ndarray,
    free_gap: np.ndarray,
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
    pressures = (
        ("pressure_gap", FIRST, "between the tips"),
        ("pressure_tip_max", SECOND, "largest at the tips"),
        ("pressure_tip_min", THIRD, "least at the tips"),
    )
    known = [(name, c, label) for name, c, label in pressures if name in lines["cfd"]]
    panels = [
        ("gap between tip\nand plane, mm", [Curve(time, v * MM, n, c, s) for v, c, s, n in ways]),
        ("circulation of\nleft vortices, cm²/s", vortices),
        ("fastest flow\nbetween, m/s", speeds),
        ("pressure, Pa", [_of(lines["cfd"], name, 1.0, label, c) for name, c, label in known]),
    ]
    figure = over_time([panel for panel in panels if panel[1]], _TALL, met=met)
    figure.axes[0].set(yscale="log", ylim=(0.8 * gap.min() * MM, 1.2 * gap.max() * MM))
    return figure


def beside_single(
    pinch: dict[str, pd.DataFrame], single: dict[str, pd.DataFrame], limits: tuple[float, float]
) -> Figure:
    """Place of the vortex as seen from its tip over the bend, of the pinch and of one finger.

    Tables by source with `bend` (rad), `along_tip`, `across_tip` (m); `limits` of the bend, °.
    """
    figure, axes = new_figure(WIDTH, HEIGHT, 2, 1, sharex=True)
    for tables, style, name in ((single, "--", "single finger"), (pinch, "-", "pinch")):
        for source, table in tables.items():
            more = {"color": COLOURS[source], "label": f"{name}, {NAMES[source]}"}
            more["marker"] = "." if len(table) < 60 else "None"
            for ax, column in zip(axes, ("along_tip", "across_tip"), strict=True):
                ax.plot(np.degrees(table["bend"]), table[column] * MM, style, **more)
    axes[0].set(ylabel="beyond the tip, mm")
    axes[1].set(ylabel="to the dorsal side, mm", xlabel="bend angle, °", xlim=limits)
    axes[1].axhline(0, color=GREY, linewidth=0.8)
    axes[0].legend(loc="best")
    return figure
