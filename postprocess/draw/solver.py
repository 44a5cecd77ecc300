"""The solver's tables as figures: forces, power, losses, history and mesh quality."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from postprocess.draw.series import BESIDE
from postprocess.draw.style import CFD, GREY, PIV, THIRD, new_figure

_LOSSES = {
    "viscous": "viscosity",
    "convection": "convection scheme",
    "coupling": "pressure and velocity",
}


def forces(table: pd.DataFrame) -> Figure:
    """Force of the water on the finger, total and its viscous part."""
    figure, ax = new_figure(8.6, 3.6)
    for axis, colour in (("x", CFD), ("y", PIV)):
        total, viscous = table[f"f{axis}"] * 1e3, table[f"f{axis}_viscous"] * 1e3
        ax.plot(table["time"], total, color=colour, label=f"force along {axis}")
        ax.plot(table["time"], viscous, ":", color=colour, label=f"its viscous part, {axis}")
    ax.set(xlabel="time, s", ylabel="force, mN", title="Force of the water on the finger")
    ax.legend(**BESIDE)
    return figure


def power(table: pd.DataFrame) -> Figure:
    """Power balance: rates above, energies below, with what the dissipation does not resolve."""
    time = table["time"].to_numpy()
    storage = np.gradient(table["kinetic_energy"].to_numpy(), time)

    def total(rate):
        return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))])

    work, lost = total(table["finger_power"].to_numpy()), total(table["dissipation"].to_numpy())
    gain = (table["kinetic_energy"] - table["kinetic_energy"].iloc[0]).to_numpy()
    figure, axes = new_figure(8.6, 6.0, 2, 1, sharex=True)
    axes[0].plot(time, table["finger_power"] * 1e3, color=CFD, label="finger on water")
    axes[0].plot(time, storage * 1e3, color=THIRD, label="change of kinetic energy")
    axes[0].plot(time, table["dissipation"] * 1e3, color=PIV, label="dissipation")
    axes[0].set(ylabel="power, mW", title="Power balance")
    axes[1].plot(time, work * 1e3, color=CFD, label="work of the finger")
    axes[1].plot(time, gain * 1e3, color=THIRD, label="kinetic energy")
    axes[1].plot(time, lost * 1e3, color=PIV, label="dissipated")
    axes[1].plot(time, (work - gain - lost) * 1e3, color=GREY, linestyle="--", label="not resolved")
    axes[1].set(xlabel="time, s", ylabel="energy, mJ")
    for ax in axes:
        ax.legend(**BESIDE)
    return figure


def losses(power: pd.DataFrame, terms: pd.DataFrame) -> Figure:
    """What each term takes from the flow over time, beside what the power balance loses."""
    figure, ax = new_figure(8.6, 3.6)
    time = power["time"].to_numpy()
    storage = np.gradient(power["kinetic_energy"].to_numpy(), time)
    lost, taken = (power["finger_power"] - storage) * 1e3, terms[list(_LOSSES)].sum(axis=1) * 1e3
    ax.plot(time, lost, color=GREY, label="work less kinetic energy")
    ax.plot(terms["time"], taken, "k.", label="sum of the three")
    for (name, words), colour in zip(_LOSSES.items(), (PIV, CFD, THIRD), strict=True):
        ax.plot(terms["time"], terms[name] * 1e3, color=colour, label=words)
    ax.set(xlabel="time, s", ylabel="loss, mW", title="Where the energy goes")
    ax.legend(**BESIDE)
    return figure


def history(table: pd.DataFrame) -> Figure:
    """Courant number and continuity error over time."""
    figure, axes = new_figure(8.6, 4.6, 2, 1, sharex=True)
    axes[0].plot(table["time"], table["courant_max"], color=CFD, label="largest")
    axes[0].plot(table["time"], table["courant_mean"], color=THIRD, label="mean")
    axes[0].set(ylabel="Courant number, 1", title="Courant number and continuity")
    axes[0].legend()
    for name, colour, label in (
        ("continuity_local", CFD, "local"),
        ("continuity_global", PIV, "global"),
    ):
        size = table[name].abs()
        axes[1].semilogy(table["time"], size.where(size > 0), color=colour, label=label)
    axes[1].set(xlabel="time, s", ylabel="continuity error, 1")
    axes[1].legend()
    return figure


def mesh_quality(table: pd.DataFrame) -> Figure:
    """Non-orthogonality and skewness over the bend angle; a line for each interval of the run."""
    figure, axes = new_figure(8.6, 4.6, 2, 1, sharex=True)
    first = table["interval"].iloc[0]
    lines = (
        (axes[0], "max_non_orthogonality_deg", CFD, "largest"),
        (axes[0], "mean_non_orthogonality_deg", THIRD, "mean"),
        (axes[1], "max_skewness", CFD, "largest skewness"),
        (axes[1], "min_area_ratio", PIV, "smallest area ratio"),
    )
    for ax, column, colour, label in lines:
        for interval, part in table.groupby("interval"):
            ax.plot(
                part["bend_deg"],
                part[column],
                color=colour,
                label=label if interval == first else None,
            )
    axes[0].set(ylabel="non-orthogonality, °", ylim=(0, None), title="Mesh quality over the stroke")
    axes[0].legend()
    axes[1].set(xlabel="bend angle, °", ylabel="1", ylim=(0, None))
    axes[1].legend()
    return figure


def costs(stages: list[dict]) -> Figure:
    """Wall time and peak memory per stage as bars."""
    figure, axes = new_figure(8.6, 0.8 + 0.34 * max(len(stages), 2), 1, 2, sharey=True)
    names = [s["stage"] for s in stages]
    for ax, values, label, form in (
        (axes[0], [s["wall_time"] for s in stages], "wall time, s", "{:.1f}"),
        (axes[1], [s["peak_memory"] / 1e9 for s in stages], "peak memory, GB", "{:.2f}"),
    ):
        bars = ax.barh(names, values, color=CFD, height=0.65)
        ax.bar_label(bars, labels=[form.format(v) for v in values], padding=3, fontsize=9)
        ax.set_xlabel(label)
        ax.margins(x=0.18)
        ax.grid(axis="y", visible=False)
    axes[0].invert_yaxis()
    return figure
