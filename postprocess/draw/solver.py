"""The solver's tables as figures: where the energy goes, time step and mesh."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.integrate import cumulative_trapezoid

from postprocess.draw.style import FIRST, GREY, HEIGHT, INK, SECOND, WIDTH, new_figure

_TAKERS = {
    "kinetic_energy": ("kinetic energy of the water", "#4d8fc4"),
    "viscous": ("taken by viscosity", "#9aa5b1"),
    "convection": ("taken by the convection scheme", "#e3b778"),
    "coupling": ("taken by pressure-velocity coupling", "#c98fbf"),
}


def energy(power: pd.DataFrame, terms: pd.DataFrame) -> Figure:
    """The finger's work over time, and what has become of it, stacked."""
    figure, ax = new_figure(WIDTH, HEIGHT)
    time = terms["time"].to_numpy()
    kinetic = power["kinetic_energy"] - power["kinetic_energy"].iloc[0]
    parts = {"kinetic_energy": np.interp(time, power["time"], kinetic)}
    parts |= {n: cumulative_trapezoid(terms[n], time, initial=0) for n in _TAKERS if n in terms}
    names, colours = zip(*(_TAKERS[name] for name in parts), strict=True)
    stacked = np.stack([parts[name] for name in parts]) * 1e3
    ax.stackplot(time, stacked, labels=names, colors=colours, linewidth=0)
    work = cumulative_trapezoid(power["finger_power"], power["time"], initial=0)
    ax.plot(power["time"], work * 1e3, color=INK, label="work of the finger")
    ax.set(xlabel="time, s", ylabel="energy, mJ", title="Where the finger's work goes")
    ax.margins(x=0)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, reverse=True)
    return figure


def numerics(history: pd.DataFrame, quality: pd.DataFrame) -> Figure:
    """Courant number over time; non-orthogonality and skewness of the mesh over the bend."""
    figure, axes = new_figure(WIDTH, HEIGHT, 3, 1)
    for name, colour in (("largest", FIRST), ("mean", GREY)):
        column = {"largest": "courant_max", "mean": "courant_mean"}[name]
        axes[0].plot(history["time"], history[column], color=colour, label=name)
    for name, colour in (("max", FIRST), ("mean", GREY)):
        for _, part in quality.groupby("interval"):
            column = part[f"{name}_non_orthogonality_deg"]
            axes[1].plot(part["bend_deg"], column, color=colour)
    for _, part in quality.groupby("interval"):
        axes[2].plot(part["bend_deg"], part["max_skewness"], color=SECOND)
    axes[0].set(xlabel="time, s", ylabel="Courant\nnumber, 1", title="Time step and mesh")
    axes[0].legend(loc="best", ncols=2)
    axes[1].set(ylabel="non-orthogo-\nnality, °")
    axes[2].set(xlabel="bend angle, °", ylabel="largest\nskewness, 1")
    for ax in axes:
        ax.set_ylim(0, None)
    figure.align_ylabels(axes)
    return figure
