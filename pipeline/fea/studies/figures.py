"""Figures of the studies in the manner of the paper's Figs 3c, 5c, 7 and 8c."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fileio.atomic import whole
from fileio.formats.bending_states import BendingStates
from pipeline.fea.envelope import outline
from pipeline.fea.paper_equations import LOWEST_VALID_PRESSURE
from pipeline.fea.paper_equations import bend as paper_bend
from pipeline.fea.studies.tables import Bends

FloatArray = NDArray[np.float64]
LARGEST = 150.0  # mm; radii beyond are nearly straight and would flatten the rest


def _axes(title: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.add_subplot()
    axes.set(
        xlabel="pressure (kPa)",
        ylabel="bending radius |R| (mm)",
        title=title,
        xlim=(-42, 42),
        ylim=(0, LARGEST),
    )
    axes.axvline(0, color="0.8", lw=1)
    axes.grid(alpha=0.3)
    return figure, axes


def _curve(
    axes: Axes, pressure: FloatArray, radius: FloatArray, label: str, **style: object
) -> None:
    """|R| over both branches, which R = ∞ at rest keeps apart."""
    bent = np.where(np.isinf(radius), np.nan, np.abs(radius)) * 1e3
    axes.plot(pressure / 1e3, bent, label=label, **style)  # type: ignore[arg-type]


def _paper(axes: Axes) -> None:
    """Equations (1)–(6), to where they know no contact."""
    for low, high in ((LOWEST_VALID_PRESSURE, -3e3), (3e3, 40e3)):
        pressure = np.linspace(low, high, 80)
        label = "equations (1)–(6)" if high > 0 else "_"
        _curve(axes, pressure, paper_bend(pressure)[1], label, color="k", ls="--", lw=1.2)


def _family(bends: dict[str, Bends], labels: dict[str, str], title: str) -> Figure:
    figure, axes = _axes(title)
    colours = mpl.colormaps["viridis"](np.linspace(0, 0.9, len(labels)))
    for (name, label), colour in zip(labels.items(), colours, strict=True):
        _curve(
            axes,
            bends[name].pressure,
            bends[name].radius,
            label,
            color=colour,
            marker="o",
            ms=3,
            lw=1.2,
        )
    _paper(axes)
    axes.legend(fontsize=8)
    return figure


def _default(states: BendingStates) -> Figure:
    figure, axes = _axes("default actuator, with what is not known of it")
    _curve(axes, states.pressure, states.radius, "unit cell")
    if states.radius_std is not None:
        bent = np.isfinite(states.radius) & (np.abs(states.pressure) > 2e3)
        curvature = 1 / np.abs(states.radius[bent])
        std = states.radius_std[bent] * curvature**2
        low, high = 1e3 / (curvature + 2 * std), 1e3 / np.maximum(curvature - 2 * std, 1e-9)
        for sign in (-1, 1):
            side = np.sign(states.pressure[bent]) == sign
            label = "± 2 standard uncertainties" if sign > 0 else "_"
            axes.fill_between(
                states.pressure[bent][side] / 1e3,
                low[side],
                high[side],
                alpha=0.25,
                color="C0",
                label=label,
            )
    _paper(axes)
    axes.legend(fontsize=8)
    return figure


def _shapes(states: BendingStates) -> Figure:
    figure = Figure(figsize=(6.4, 5.6), layout="constrained")
    axes = figure.add_subplot()
    shown = [
        int(np.abs(states.pressure - p * 1e3).argmin()) for p in (-40, -20, -10, 0, 10, 20, 30, 40)
    ]
    for number, colour in zip(
        shown, mpl.colormaps["coolwarm"](np.linspace(0, 1, len(shown))), strict=True
    ):
        line = outline(states.profile[number], states.thickness[number]) * 1e3
        axes.fill(
            *line.T,
            facecolor=colour,
            edgecolor="k",
            lw=0.6,
            alpha=0.6,
            label=f"{states.pressure[number] / 1e3:g} kPa",
        )
    axes.set(
        xlabel="x (mm), root to tip",
        ylabel="y (mm), towards the ventral side",
        title="outline of the default actuator",
        aspect="equal",
    )
    figure.legend(fontsize=8, loc="outside right upper")
    return figure


def draw(folder: Path, bends: dict[str, Bends], states: BendingStates) -> None:
    """Write theta.svg, width.svg, materials.svg, default.svg and shapes.svg."""
    wedges = {name: f"θ = {name.split('_')[1]}°" for name in bends if name.startswith("theta_")}
    widths = {name: f"W = {name.split('_')[1]} mm" for name in bends if name.startswith("width_")}
    pairs = {
        "u10_l30": "upper DS10, lower DS30",
        "u30_l30": "both DS30",
        "u30_l10": "upper DS30, lower DS10",
    }
    figures = {
        "theta": _family(bends, wedges, "top wedge angle (paper, Fig. 7)"),
        "width": _family(bends, widths, "width (paper, Fig. 3c)"),
        "materials": _family(bends, pairs, "materials of the layers (paper, Fig. 8c)"),
        "default": _default(states),
        "shapes": _shapes(states),
    }
    mpl.rcParams["svg.hashsalt"] = "softfinger"  # the same figure gives the same file
    for name, figure in figures.items():
        with whole(folder / f"{name}.svg", suffix=True) as part:
            figure.savefig(part, metadata={"Date": None})
