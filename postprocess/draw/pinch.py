"""Series of two fingers over time: the pair of vortices, the flow between, the closing."""

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
from postprocess.evidence.half_planes import BELOW, names_at
from postprocess.evidence.pair_integrals import DORSAL, VENTRAL, vortex_of
from postprocess.evidence.vortex_pairs import broken

_CM2, _CM3 = 1e4, 1e6
_TALL = 7.6  # inches: four or five panels
_SIDES = ((0, "left", "-"), (1, "right", "--"))


def _of(table: pd.DataFrame, column: str, factor: float, label: str, colour: str, style="-"):
    values = table[column].to_numpy(float) * factor
    return Curve(table["time"].to_numpy(), values, label, colour, style)


def pair(pairs: dict[str, pd.DataFrame]) -> Figure:
    """Imbalance of circulation, mirror distance and place as seen from the tips over time."""
    tables = {s: broken(table, "track_0", "track_1") for s, table in pairs.items()}

    def both(column: str, factor: float) -> list[Curve]:
        return [_of(t, column, factor, NAMES[s], COLOURS[s]) for s, t in tables.items()]

    def each(column: str) -> list[Curve]:
        return [
            _of(t, f"{column}_{finger}", MM, f"{NAMES[s]}, {side}", COLOURS[s], style)
            for s, t in tables.items()
            for finger, side, style in _SIDES
        ]

    panels = [
        ("imbalance, %", both("imbalance", 100)),
        ("mirror\ndistance, mm", both("mirror_distance", MM)),
        ("along the\ntip, mm", each("along_tip")),
        ("to the dorsal\nside, mm", each("across_tip")),
    ]
    return over_time(panels, _TALL)


def centreline(
    lines: dict[str, pd.DataFrame], tip_time: np.ndarray, tip_height: np.ndarray, met: float | None
) -> Figure:
    """Height (m) at which the flow parts, and the fastest flow below and above it (m/s)."""
    heights, speeds = [Curve(tip_time, tip_height * MM, "tips", GREY, "--")], []
    for source, table in lines.items():
        table = table.assign(jet_y=table["jet_y"].where(table["jet_speed"] > 0.02))
        colour, name = COLOURS[source], NAMES[source]
        heights.append(_of(table, "stagnation_y", MM, f"parting, {name}", colour))
        heights.append(_of(table, "jet_y", MM, f"fastest of the jet, {name}", colour, ":"))
        speeds.append(_of(table, "jet_speed", 1.0, f"down, {name}", colour))
        speeds.append(_of(table, "rise_speed", 1.0, f"up, {name}", colour, "--"))
    figure = over_time([("y, mm", heights), ("peak speed, m/s", speeds)], _TALL, met=met)
    shown = np.concatenate([curve.values for curve in heights])
    figure.axes[0].set_ylim(np.nanmin(shown) - 3, np.nanmax(shown) + 3)
    return figure


def integrals(
    pairs: dict[str, pd.DataFrame], halves: dict[str, pd.DataFrame], met: float | None
) -> Figure:
    """The left half of the plane by source: both pairs, circulation and impulse, and the jet.

    Tables as of pair_integrals and half_planes; `met`: contact, s.
    """
    vortices, circulation, impulse, speed, flux = [], [], [], [], []
    for source, table in pairs.items():
        name, half, colour = NAMES[source], halves[source], COLOURS[source]
        for (side, flow), style in ((DORSAL, "-"), (VENTRAL, "--")):
            rows = vortex_of(table, side, flow, 0)
            vortices.append(_of(rows, "circulation", _CM2, f"{side}, {name}", colour, style))
        circulation.append(_of(half, "circulation_0", _CM2, name, colour))
        impulse.append(_of(half, "impulse_0", _CM3, name, colour))
        for depth, style in zip(BELOW, ("-", "--", ":"), strict=True):
            fast, through = names_at(depth)
            label = f"{depth * MM:.0f} mm below, {name}"
            speed.append(_of(half, fast, 1.0, label, colour, style))
            flux.append(_of(half, through, _CM3, "", colour, style))
    panels = [
        ("circulation of\nleft vortices,\ncm²/s", vortices),
        ("circulation of\nleft half, cm²/s", circulation),
        ("impulse of left\nhalf, cm³/s", impulse),
        ("speed of the\njet, m/s", speed),
        ("flux of the\njet, cm³/s²", flux),
    ]
    return over_time(panels, _TALL, met=met)


def closing(
    time: np.ndarray, gap: np.ndarray, free_gap: np.ndarray, lines: pd.DataFrame, met: float | None
) -> Figure:
    """Gap and closing speed of a tip, with the law and without (m over s), pressure and jet."""
    ways = ((gap, FIRST, "-", "as it closes"), (free_gap, GREY, "--", "unhindered"))
    pressures = (
        ("pressure_gap", FIRST, "between the tips"),
        ("pressure_tip_max", SECOND, "largest at the tips"),
        ("pressure_tip_min", THIRD, "least at the tips"),
    )
    panels = [
        ("gap between tip\nand plane, mm", [Curve(time, v * MM, n, c, s) for v, c, s, n in ways]),
        (
            "closing speed\nof a tip, m/s",
            [Curve(time, -np.gradient(v, time), "", c, s) for v, c, s, _ in ways],
        ),
        (
            "pressure, Pa",
            [_of(lines, name, 1.0, label, c) for name, c, label in pressures if name in lines],
        ),
        ("jet, m/s", [_of(lines, "jet_speed", 1.0, "", FIRST)]),
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
