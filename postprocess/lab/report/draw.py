"""Figures of a comparison with a laboratory: time series, motion and registration."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from postprocess.draw.style import CFD, GREY, LAB, PIV, SHADED, new_figure

COLOUR = {"data": LAB, "virtual": PIV, "direct": CFD}
NAME = {"data": "laboratory (DPIV)", "virtual": "simulation, seen by the same PIV"}
NAME["direct"] = "simulation, direct"
K95 = 1.96


def series(
    table: pd.DataFrame, quantities: dict[str, dict[str, Any]], window: tuple[float, float]
) -> Figure:
    """Circulation over time with 95 % bands of each instant on both sides."""
    figure, ax = new_figure(8.8, 4.4)
    instant, unit = quantities["circulation"]["u_instant"], 1e4
    simulated = "virtual" if "circulation_virtual" in table else "direct"
    half = {"data": instant["data"][0], simulated: instant["simulation"][0]}
    for side in ("direct", "virtual", "data"):
        if f"circulation_{side}" not in table:
            continue
        values, time = table[f"circulation_{side}"], table["time"]
        line = ":" if side == "direct" else "-"
        ax.plot(time, values * unit, line, color=COLOUR[side], label=NAME[side])
        if side in half:
            low, high = ((values + s * K95 * half[side]) * unit for s in (-1, 1))
            ax.fill_between(time, low, high, color=COLOUR[side], alpha=0.2, lw=0)
    ax.axvspan(*window, color=SHADED, zorder=0)
    ax.set(xlabel="time of the simulation, s", ylabel="circulation, cm²/s")
    ax.set_title("Tip vortex (shaded: the instants compared); bands hold 95 % of each instant")
    ax.legend(loc="best")
    return figure


def motion(
    table: pd.DataFrame, registration: dict[str, Any], times: np.ndarray, bends: np.ndarray
) -> Figure:
    """Bend angle over time: simulation, fitted law, and single frames at `times` (s)."""
    figure, ax = new_figure(8.8, 3.8)
    ax.plot(table["time"], table["bend_deg_direct"], color=CFD, label="simulation")
    ax.plot(table["time"], table["bend_deg_data"], color=LAB, label="recording, fitted law")
    if times.size:
        ax.plot(times, np.degrees(bends), ".", color=GREY, ms=5, label="recording, single frames")
    law = f"factor {registration['pressure_factor']:.3f}, duration × {registration['stretch']:.3f}"
    ax.set(xlabel="time of the simulation, s", ylabel="bend angle, °")
    ax.set_title(f"Motion of the finger ({law})")
    ax.legend(loc="best")
    return figure


def overlay(picture: np.ndarray, fitted: np.ndarray, simulated: np.ndarray) -> Figure:
    """A picture of the recording with the fitted and the simulated outline (px, y up)."""
    rows, columns = picture.shape
    figure, ax = new_figure(7.6, 7.6 * rows / columns + 0.5)
    bright = float(np.percentile(picture, 99.5))
    ax.imshow(picture[::-1], "gray", origin="lower", vmax=bright, interpolation="nearest")
    for outline, name, colour in (
        (fitted, "recording, fitted", "#27c267"),
        (simulated, "simulation", "#ff8c42"),
    ):
        ax.plot(*np.vstack([outline, outline[:1]]).T, color=colour, lw=1.4, label=name)
    ax.grid(False)
    ax.set(xlabel="px", ylabel="px", xlim=(0, columns), ylim=(0, rows))
    ax.set_title("The finger found in the picture")
    ax.legend(loc="lower right", facecolor="white", frameon=True)
    return figure
