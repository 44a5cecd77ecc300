"""Series of two fingers over time: the pair of vortices, the flow between the fingers, the closing of the gap."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from postprocess.draw.series import BESIDE
from postprocess.draw.style import CFD, COLOURS, GREY, MM, NAMES, PIV, THIRD, new_figure
from postprocess.evidence.half_planes import BELOW, names_at
from postprocess.evidence.pair_integrals import DORSAL, VENTRAL, vortex_of
from postprocess.evidence.vortex_pairs import broken


def _with_contact(figure: Figure, axes, met: float | None, explained) -> Figure:
    """The figure with a line at contact (s) in every panel, and legends beside those that are `explained`."""
    for ax in axes:
        if met is not None:
            ax.axvline(met, color=GREY, linewidth=1.0, linestyle=":", label="contact")
    for ax in explained:
        ax.legend(**BESIDE)
    return figure


def pair(pairs: dict[str, pd.DataFrame]) -> Figure:
    """Imbalance of circulation, mirror distance of the centres and place as seen from the tips over time."""
    figure, axes = new_figure(8.6, 7.4, 4, 1, sharex=True)
    for source, whole in pairs.items():
        table = broken(whole, "track_0", "track_1")
        time, colour, label = table["time"], COLOURS[source], NAMES[source]
        axes[0].plot(time, table["imbalance"] * 100, color=colour, label=label)
        axes[1].plot(time, table["mirror_distance"] * MM, color=colour, label=label)
        for ax, name in ((axes[2], "along_tip"), (axes[3], "across_tip")):
            ax.plot(time, table[f"{name}_0"] * MM, "-", color=colour, label=f"{label}, left")
            ax.plot(time, table[f"{name}_1"] * MM, "--", color=colour, label=f"{label}, right")
    axes[0].set(
        ylabel="imbalance, %", ylim=(0, 15), title="The two tip vortices against each other"
    )
    # an instant at which another vortex is paired by mistake must not set the scale
    usual = max(
        (float(table["mirror_distance"].quantile(0.95)) for table in pairs.values() if len(table)),
        default=0.0,
    )
    axes[1].set(ylabel="mirror\ndistance, mm", ylim=(0, max(1.5 * usual * MM, 0.1)))
    axes[2].set(ylabel="along the\ntip, mm")
    axes[3].set(ylabel="to the dorsal\nside, mm", xlabel="time, s")
    return _with_contact(figure, axes, None, (axes[0], axes[2]))


def centreline(
    lines: dict[str, pd.DataFrame], tip_time: np.ndarray, tip_height: np.ndarray, met: float | None
) -> Figure:
    """Height at which the flow between the fingers parts, and the fastest flow below and above it; tip height (n) in m."""
    figure, axes = new_figure(8.6, 5.8, 2, 1, sharex=True)
    axes[0].plot(tip_time, tip_height * MM, color=GREY, linestyle="--", linewidth=1.2, label="tips")
    for source, table in lines.items():
        time, colour, name = table["time"], COLOURS[source], NAMES[source]
        jet = table["jet_y"].where(table["jet_speed"] > 0.02) * MM
        axes[0].plot(time, table["stagnation_y"] * MM, color=colour, label=f"parting, {name}")
        axes[0].plot(time, jet, ":", color=colour, label=f"fastest of the jet, {name}")
        axes[1].plot(time, table["jet_speed"], color=colour, label=f"down, {name}")
        axes[1].plot(time, table["rise_speed"], "--", color=colour, label=f"up, {name}")
    axes[0].set(ylabel="y, mm", title="On the plane between the fingers")
    axes[1].set(ylabel="peak speed, m/s", xlabel="time, s", ylim=(0, None))
    return _with_contact(figure, axes, met, axes)


def integrals(
    pairs: dict[str, pd.DataFrame], halves: dict[str, pd.DataFrame], met: float | None
) -> Figure:
    """Left half of the plane over time, by source: both pairs' circulation, the half's and its impulse, and the jet's speed and flux.

    Tables as of pair_integrals and half_planes; `met`: contact, s.
    """
    figure, axes = new_figure(8.6, 10.0, 5, 1, sharex=True)
    for source, table in pairs.items():
        colour, name = COLOURS[source], NAMES[source]
        for (side, flow), style in ((DORSAL, "-"), (VENTRAL, "--")):
            rows = vortex_of(table, side, flow, 0)
            axes[0].plot(
                rows["time"],
                rows["circulation"] * 1e4,
                style,
                color=colour,
                label=f"{side} vortex, {name}",
            )
        half = halves[source]
        axes[1].plot(half["time"], half["circulation_0"] * 1e4, color=colour, label=name)
        axes[2].plot(half["time"], half["impulse_0"] * 1e6, color=colour, label=name)
        for depth, style in zip(BELOW, ("-", "--", ":"), strict=True):
            for ax, column, unit in zip(axes[3:], names_at(depth), (1.0, 1e6), strict=True):
                label = f"{depth * MM:.0f} mm below, {name}"
                ax.plot(half["time"], half[column] * unit, style, color=colour, label=label)
    axes[0].set(
        ylabel="circulation of the\nleft vortices, cm²/s",
        title="By integrals: the pairs, half the plane, the jet",
    )
    axes[1].set(ylabel="circulation of the\nleft half, cm²/s")
    axes[2].set(ylabel="impulse of the left\nhalf, cm³/s")
    axes[3].set(ylabel="speed of the\njet, m/s", ylim=(0, None))
    axes[4].set(ylabel="flux of the jet,\ncm³/s²", xlabel="time, s", ylim=(0, None))
    return _with_contact(figure, axes, met, (axes[0], axes[3]))


def closing(
    time: np.ndarray, gap: np.ndarray, free_gap: np.ndarray, lines: pd.DataFrame, met: float | None
) -> Figure:
    """Gap and closing speed of one tip, with the law and without it (m over s), and what they do to pressure and jet."""
    figure, axes = new_figure(8.6, 8.2, 4, 1, sharex=True)
    axes[0].semilogy(time, gap * MM, color=CFD, label="as it closes")
    axes[0].semilogy(
        time, free_gap * MM, "--", color=GREY, label="unhindered, until the tips would meet"
    )
    axes[0].set(ylabel="gap between tip\nand plane, mm", title="Closing")
    axes[1].plot(time, -np.gradient(gap, time), color=CFD)
    axes[1].plot(time, -np.gradient(free_gap, time), color=GREY, linestyle="--")
    axes[1].set(ylabel="closing speed\nof a tip, m/s")
    if "pressure_gap" in lines:
        axes[2].plot(lines["time"], lines["pressure_gap"], color=CFD, label="between the tips")
        axes[2].plot(
            lines["time"], lines["pressure_tip_max"], color=PIV, label="largest at the tips"
        )
        axes[2].plot(
            lines["time"], lines["pressure_tip_min"], color=THIRD, label="least at the tips"
        )
    axes[2].set(ylabel="pressure, Pa")
    axes[3].plot(lines["time"], lines["jet_speed"], color=CFD)
    axes[3].set(ylabel="jet, m/s", xlabel="time, s", ylim=(0, None))
    return _with_contact(figure, axes, met, (axes[0], axes[2]))


def beside_single(
    pinch: dict[str, pd.DataFrame], single: dict[str, pd.DataFrame], limits: tuple[float, float]
) -> Figure:
    """Place of the vortex as seen from its tip over the bend angle: both fingers of the pinch, and the single finger.

    Tables with `bend` (rad), `along_tip`, `across_tip` (m), the pinch's by name; `limits` of the bend shown, degrees.
    """
    figure, axes = new_figure(8.6, 5.6, 2, 1, sharex=True)
    for tables, style, name in ((single, "--", "single finger"), (pinch, "-", "pinch")):
        for source, table in tables.items():
            for ax, column in zip(axes, ("along_tip", "across_tip"), strict=True):
                (line,) = ax.plot(
                    np.degrees(table["bend"]), table[column] * MM, style, color=COLOURS[source]
                )
                line.set(
                    marker="." if len(table) < 60 else "None", label=f"{name}, {NAMES[source]}"
                )
    axes[0].set(
        ylabel="beyond the tip, mm", title="The vortex at the same bend, pinch and single finger"
    )
    axes[1].set(ylabel="to the dorsal side, mm", xlabel="bend angle, °", xlim=limits)
    axes[1].axhline(0, color=GREY, linewidth=0.8)
    axes[0].legend(loc="best")
    return figure
