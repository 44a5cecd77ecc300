"""Series of two fingers over time: the pair of vortices, the flow between, the closing."""

from __future__ import annotations

from functools import partial

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from postprocess.draw.series import BESIDE
from postprocess.draw.style import CFD, COLOURS, GREY, MM, NAMES, PIV, THIRD, new_figure
from postprocess.evidence.half_planes import BELOW, names_at
from postprocess.evidence.pair_integrals import DORSAL, VENTRAL, vortex_of
from postprocess.evidence.vortex_pairs import broken

_CM2, _CM3 = 1e4, 1e6


def _line(ax, table: pd.DataFrame, column: str, style: str, factor: float, **more) -> None:
    ax.plot(table["time"], table[column] * factor, style, **more)


def _with_contact(figure: Figure, axes, met: float | None, explained) -> Figure:
    """The figure with a line at contact (s) in every panel, and some legends beside."""
    for ax in axes:
        if met is not None:
            ax.axvline(met, color=GREY, linewidth=1.0, linestyle=":", label="contact")
    for ax in explained:
        ax.legend(**BESIDE)
    return figure


def pair(pairs: dict[str, pd.DataFrame]) -> Figure:
    """Imbalance of circulation, mirror distance and place as seen from the tips over time."""
    figure, axes = new_figure(8.6, 7.4, 4, 1, sharex=True)
    usual = 0.0  # an instant at which another vortex is paired by mistake must not set the scale
    for source, whole in pairs.items():
        if len(whole):
            usual = max(usual, float(whole["mirror_distance"].quantile(0.95)))
        table, name = broken(whole, "track_0", "track_1"), NAMES[source]
        draw = partial(_line, table=table, color=COLOURS[source])
        draw(axes[0], column="imbalance", style="-", factor=100, label=name)
        draw(axes[1], column="mirror_distance", style="-", factor=MM, label=name)
        for ax, column in ((axes[2], "along_tip"), (axes[3], "across_tip")):
            for finger, side, style in ((0, "left", "-"), (1, "right", "--")):
                label = f"{name}, {side}"
                draw(ax, column=f"{column}_{finger}", style=style, factor=MM, label=label)
    title = "The two tip vortices against each other"
    axes[0].set(ylabel="imbalance, %", ylim=(0, 15), title=title)
    axes[1].set(ylabel="mirror\ndistance, mm", ylim=(0, max(1.5 * usual * MM, 0.1)))
    axes[2].set(ylabel="along the\ntip, mm")
    axes[3].set(ylabel="to the dorsal\nside, mm", xlabel="time, s")
    return _with_contact(figure, axes, None, (axes[0], axes[2]))


def centreline(
    lines: dict[str, pd.DataFrame], tip_time: np.ndarray, tip_height: np.ndarray, met: float | None
) -> Figure:
    """Height (m) at which the flow parts, and the fastest flow below and above it (m/s)."""
    figure, axes = new_figure(8.6, 5.8, 2, 1, sharex=True)
    axes[0].plot(tip_time, tip_height * MM, color=GREY, linestyle="--", linewidth=1.2, label="tips")
    for source, table in lines.items():
        table = table.assign(jet_y=table["jet_y"].where(table["jet_speed"] > 0.02))
        for ax, column, style, factor, label in (
            (axes[0], "stagnation_y", "-", MM, "parting"),
            (axes[0], "jet_y", ":", MM, "fastest of the jet"),
            (axes[1], "jet_speed", "-", 1.0, "down"),
            (axes[1], "rise_speed", "--", 1.0, "up"),
        ):
            more = {"color": COLOURS[source], "label": f"{label}, {NAMES[source]}"}
            _line(ax, table, column, style, factor, **more)
    axes[0].set(ylabel="y, mm", title="On the plane between the fingers")
    axes[1].set(ylabel="peak speed, m/s", xlabel="time, s", ylim=(0, None))
    return _with_contact(figure, axes, met, axes)


def integrals(
    pairs: dict[str, pd.DataFrame], halves: dict[str, pd.DataFrame], met: float | None
) -> Figure:
    """The left half of the plane by source: both pairs, circulation and impulse, and the jet.

    Tables as of pair_integrals and half_planes; `met`: contact, s.
    """
    figure, axes = new_figure(8.6, 10.0, 5, 1, sharex=True)
    for source, table in pairs.items():
        name, half = NAMES[source], halves[source]
        draw = partial(_line, color=COLOURS[source])
        for (side, flow), style in ((DORSAL, "-"), (VENTRAL, "--")):
            rows, label = vortex_of(table, side, flow, 0), f"{side} vortex, {name}"
            draw(axes[0], rows, "circulation", style, _CM2, label=label)
        draw(axes[1], half, "circulation_0", "-", _CM2, label=name)
        draw(axes[2], half, "impulse_0", "-", _CM3, label=name)
        for depth, style in zip(BELOW, ("-", "--", ":"), strict=True):
            label = f"{depth * MM:.0f} mm below, {name}"
            for ax, column, factor in zip(axes[3:], names_at(depth), (1.0, _CM3), strict=True):
                draw(ax, half, column, style, factor, label=label)
    labels = (
        "circulation of the\nleft vortices, cm²/s",
        "circulation of the\nleft half, cm²/s",
        "impulse of the left\nhalf, cm³/s",
        "speed of the\njet, m/s",
        "flux of the jet,\ncm³/s²",
    )
    for ax, label in zip(axes, labels, strict=True):
        ax.set_ylabel(label)
    axes[0].set_title("By integrals: the pairs, half the plane, the jet")
    axes[3].set_ylim(0, None)
    axes[4].set(xlabel="time, s", ylim=(0, None))
    return _with_contact(figure, axes, met, (axes[0], axes[3]))


def closing(
    time: np.ndarray, gap: np.ndarray, free_gap: np.ndarray, lines: pd.DataFrame, met: float | None
) -> Figure:
    """Gap and closing speed of a tip, with the law and without (m over s), pressure and jet."""
    figure, axes = new_figure(8.6, 8.2, 4, 1, sharex=True)
    unhindered = "unhindered, until the tips would meet"
    for values, style, colour, label in (
        (gap, "-", CFD, "as it closes"),
        (free_gap, "--", GREY, unhindered),
    ):
        axes[0].semilogy(time, values * MM, style, color=colour, label=label)
        axes[1].plot(time, -np.gradient(values, time), style, color=colour)
    axes[0].set(ylabel="gap between tip\nand plane, mm", title="Closing")
    axes[1].set(ylabel="closing speed\nof a tip, m/s")
    for column, colour, label in (
        ("pressure_gap", CFD, "between the tips"),
        ("pressure_tip_max", PIV, "largest at the tips"),
        ("pressure_tip_min", THIRD, "least at the tips"),
    ):
        if column in lines:
            _line(axes[2], lines, column, "-", 1.0, color=colour, label=label)
    axes[2].set(ylabel="pressure, Pa")
    _line(axes[3], lines, "jet_speed", "-", 1.0, color=CFD)
    axes[3].set(ylabel="jet, m/s", xlabel="time, s", ylim=(0, None))
    return _with_contact(figure, axes, met, (axes[0], axes[2]))


def beside_single(
    pinch: dict[str, pd.DataFrame], single: dict[str, pd.DataFrame], limits: tuple[float, float]
) -> Figure:
    """Place of the vortex as seen from its tip over the bend, of the pinch and of one finger.

    Tables by source with `bend` (rad), `along_tip`, `across_tip` (m); `limits` of the bend, °.
    """
    figure, axes = new_figure(8.6, 5.6, 2, 1, sharex=True)
    for tables, style, name in ((single, "--", "single finger"), (pinch, "-", "pinch")):
        for source, table in tables.items():
            more = {"color": COLOURS[source], "label": f"{name}, {NAMES[source]}"}
            more["marker"] = "." if len(table) < 60 else "None"
            for ax, column in zip(axes, ("along_tip", "across_tip"), strict=True):
                ax.plot(np.degrees(table["bend"]), table[column] * MM, style, **more)
    title = "The vortex at the same bend, pinch and single finger"
    axes[0].set(ylabel="beyond the tip, mm", title=title)
    axes[1].set(ylabel="to the dorsal side, mm", xlabel="bend angle, °", xlim=limits)
    axes[1].axhline(0, color=GREY, linewidth=0.8)
    axes[0].legend(loc="best")
    return figure
