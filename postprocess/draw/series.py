"""Series over time, one panel for each quantity; paths of the vortex; the bend."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy import ndarray
from scipy.ndimage import median_filter

from postprocess.draw.style import (
    BODY,
    CFD,
    COLOURS,
    GREY,
    HEIGHT,
    INK,
    MM,
    NAMES,
    SHADED,
    WIDTH,
    new_figure,
)
from postprocess.evidence.vortex_pairs import broken

BAND = 1.96  # standard deviations to either side: a 95 % band
Tracks = dict[str, list[pd.DataFrame]]  # by source, of every finger the tip's vortex over time
_ONE_ROW = 64  # letters of a legend that fit side by side
_ABOVE = {
    "bbox_to_anchor": (0.0, 1.0),
    "borderaxespad": 0.1,
    "borderpad": 0.1,
    "fontsize": 8.5,
    "handlelength": 1.6,
    "columnspacing": 1.2,
}  # above the axis no legend hides a curve
_SPIKE = 3  # instants: what is shorter does not set an axis


@dataclass(frozen=True)
class Curve:
    """Values over `time` (s) in the unit of the panel, with a `band` to either side."""

    time: ndarray
    values: ndarray
    label: str = ""
    colour: str = INK
    style: str = "-"
    band: ndarray | None = None


Panels = list[tuple[str, list[Curve]]]  # the label of the axis with its unit, and the curves


def over_time(
    panels: Panels,
    height: float = HEIGHT,
    *,
    middle: tuple[float, float] | None = None,
    met: float | None = None,
) -> Figure:
    """Draw one panel below the other.

    middle: what is compared, which is shaded; met: contact of two fingers (s).

    No axis is set by a spike of a few instants, as of a solver's first steps.
    """
    figure, axes = new_figure(WIDTH, height, len(panels), 1, sharex=True, squeeze=False)
    for ax, (label, curves) in zip(axes[:, 0], panels, strict=True):
        if middle:
            ax.axvspan(*middle, color=SHADED, zorder=0)
        if met is not None:
            ax.axvline(met, color=GREY, linewidth=1.0, linestyle=":")
        for curve in curves:
            line = {"color": curve.colour, "linestyle": curve.style, "label": curve.label or None}
            ax.plot(curve.time, curve.values, **line)
            if curve.band is not None:
                sides = curve.values - curve.band, curve.values + curve.band
                ax.fill_between(curve.time, *sides, color=curve.colour, alpha=0.2, linewidth=0)
        ax.set_ylim(*_limits(curves))
        ax.set_ylabel(label, fontsize=9)
        _name_spikes(ax, curves)
        names = [curve.label for curve in curves if curve.label]
        if names:
            columns = 4 if sum(map(len, names)) < _ONE_ROW else (len(names) + 1) // 2
            ax.legend(loc="lower left", ncols=columns, **_ABOVE)
    axes[-1, 0].set_xlabel("time, s")
    figure.align_ylabels(axes[:, 0])
    return figure


def _limits(curves: list[Curve]) -> tuple[float, float]:
    """Limits of an axis with all curves and bands, but for short spikes."""
    known = [median_filter(c.values[np.isfinite(c.values)], _SPIKE, mode="nearest") for c in curves]
    known += [
        median_filter((c.values + sign * c.band)[np.isfinite(c.values)], _SPIKE, mode="nearest")
        for c in curves
        if c.band is not None
        for sign in (-1, 1)
    ]
    ends = np.concatenate([*known, [0.0]])
    low, high = float(ends.min()), float(ends.max())
    room = 0.08 * (high - low) or 1.0
    return low - room * (low < 0), high + room


def _name_spikes(ax: Axes, curves: list[Curve]) -> None:
    """The value of what is cut off, where it is."""
    low, high = ax.get_ylim()
    slack = 1e-3 * (high - low)  # rounding is no spike
    for curve in curves:
        if not np.isfinite(curve.values).any():
            continue
        for at, mark in ((np.nanargmax(curve.values), "▲"), (np.nanargmin(curve.values), "▼")):
            time, value = np.asarray(curve.time)[at], float(curve.values[at])
            if not low - slack <= value <= high + slack:
                edge, side = (high, "top") if value > high else (low, "bottom")
                late = time > np.mean(ax.get_xlim())  # the text stays within the picture
                text = f" to {value:.2g} {mark} " if late else f" {mark} to {value:.2g} "
                to = "right" if late else "left"
                ax.text(time, edge, text, color=curve.colour, fontsize=8, va=side, ha=to)


def circulations(tracks: Tracks) -> list[Curve]:
    """Circulation (cm²/s) of every tip's vortex, with its 95 % band where the table has one."""
    curves = []
    for source, fingers in tracks.items():
        for finger, track in enumerate(fingers):
            drawn = broken(track, "track")
            std = drawn.get("circulation_std")
            curves.append(
                Curve(
                    drawn["time"].to_numpy(),
                    drawn["circulation"].to_numpy() * 1e4,
                    _finger_name(source, finger, len(fingers)),
                    COLOURS[source],
                    ("-", "--")[finger],
                    None if std is None else BAND * std.to_numpy(float) * 1e4,
                )
            )
    return curves


def _finger_name(source: str, finger: int, fingers: int) -> str:
    """A legend's entry: the source, and which finger where there are two."""
    return NAMES[source] + (f", {('left', 'right')[finger]} finger" if fingers > 1 else "")


def paths(tracks: Tracks, plane: xr.Dataset, middle: tuple[float, float]) -> Figure:
    """Paths of vortex centres and tip over the outline at the first, middle and last instant."""
    figure, ax = new_figure(WIDTH, HEIGHT)
    times = plane["time"].values
    instants = [0, int(np.argmin(np.abs(times - np.mean(middle)))), times.size - 1]
    way = {"color": GREY, "ls": "--", "linewidth": 1.2}
    for number in range(plane.sizes["finger"]):
        for index, tone in zip(instants, ("#e3e6ea", "#b9c0c8", BODY), strict=True):
            outline = plane["outline"].values[index, number].T * MM
            ax.fill(*outline, facecolor=tone, edgecolor="none")
        tip = plane["tip"].values[:, number].T * MM
        ax.plot(*tip, label=None if number else "tip", **way)
    for source, fingers in tracks.items():
        for finger, track in enumerate(fingers):
            _path(ax, track, middle, source, None if finger else f"vortex, {NAMES[source]}")
    ax.set(aspect="equal", xlabel="x, mm", ylabel="y, mm", title="Where the vortex goes")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _path(
    ax, track: pd.DataFrame, middle: tuple[float, float], source: str, label: str | None
) -> None:
    drawn, colour = broken(track, "track"), COLOURS[source]
    style = {"marker": ".", "markersize": 4, "linewidth": 1.2, "label": label}
    ax.plot(drawn["x"] * MM, drawn["y"] * MM, color=colour, **style)
    inside = track[track["time"].between(*middle)]
    if {"x_std", "y_std"} <= set(track):
        some = inside.iloc[:: max(1, len(inside) // 8)]
        half = BAND * some[["y_std", "x_std"]].to_numpy().T * MM
        bars = {"fmt": "none", "ecolor": colour, "alpha": 0.7}
        ax.errorbar(some["x"] * MM, some["y"] * MM, *half, **bars)


def bending(
    pressure: ndarray, bend: ndarray, bend_std: ndarray | None, paper: ndarray | None
) -> Figure:
    """Bend over pressure (Pa) of the states with their band, and of equations (1)-(6) if given.

    `bend`, `bend_std`, `paper`: (state,) rad.
    """
    figure, ax = new_figure(WIDTH, HEIGHT)
    ax.plot(pressure / 1e3, np.degrees(bend), color=CFD, label="states")
    if paper is not None:
        equations = {"color": GREY, "label": "the paper's equations (1)–(6)"}
        ax.plot(pressure / 1e3, np.degrees(paper), "--", **equations)
    if bend_std is not None:
        sides = np.degrees([bend - bend_std, bend + bend_std])
        ax.fill_between(pressure / 1e3, *sides, color=CFD, alpha=0.2, linewidth=0)
    ax.set(xlabel="pressure, kPa", ylabel="bend, °", title="Bend over pressure")
    ax.legend()
    return figure
