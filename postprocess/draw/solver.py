"""Where the finger's work goes, as a figure."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.integrate import cumulative_trapezoid

from postprocess.draw.style import HEIGHT, INK, WIDTH, new_figure

_TAKERS = {
    "kinetic_energy": ("kinetic energy of the water", "#4d8fc4"),
    "viscous": ("taken by viscosity", "#9aa5b1"),
    "convection": ("taken by the convection scheme", "#e3b778"),
    "coupling": ("taken by pressure-velocity coupling", "#c98fbf"),
}


def energy(power: pd.DataFrame, terms: pd.DataFrame, through: pd.DataFrame | None = None) -> Figure:
    """The finger's work over time, and what has become of it, stacked.

    `through`: what a current carries through the tank's ends, whose energy counts beside the work.
    """
    figure, ax = new_figure(WIDTH, HEIGHT)
    time = terms["time"].to_numpy()
    kinetic = power["kinetic_energy"] - power["kinetic_energy"].iloc[0]
    parts = {"kinetic_energy": np.interp(time, power["time"], kinetic)}
    parts |= {n: cumulative_trapezoid(terms[n], time, initial=0) for n in _TAKERS if n in terms}
    names, colours = zip(*(_TAKERS[name] for name in parts), strict=True)
    stacked = np.stack([parts[name] for name in parts]) * 1e3
    ax.stackplot(time, stacked, labels=names, colors=colours, linewidth=0)
    work = cumulative_trapezoid(power["finger_power"], power["time"], initial=0)
    label, title = "work of the finger", "Where the finger's work goes"
    if through is not None:
        brought = cumulative_trapezoid(through["power"], through["time"], initial=0)
        work = work + np.interp(power["time"], through["time"], brought)
        label, title = "work of finger and current", "Where the work goes"
    ax.plot(power["time"], work * 1e3, color=INK, label=label)
    ax.set(xlabel="time, s", ylabel="energy, mJ", title=title)
    ax.margins(x=0)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, reverse=True)
    return figure
