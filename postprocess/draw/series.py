"""Series over time: the vortex, its agreement, the motion; and the bending radius."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from postprocess.draw.style import CFD, COLOURS, GREY, MM, NAMES, PIV, new_figure
from postprocess.evidence.vortex_pairs import broken

BAND = 1.96  # standard deviations to either side: a 95 % band
# Curves fill these pictures.
BESIDE: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)}
Tracks = dict[str, list[pd.DataFrame]]  # by source, of every finger the tip's vortex over time
_MIDDLE: dict[str, Any] = {"color": "#f0e9d8", "zorder": 0}
_LEAST_PRESSURE = 3e3  # Pa; below it R runs off to infinity


def circulation(tracks: Tracks, middle: tuple[float, float]) -> Figure:
    """Circulation and radius of every tip's vortex over time with 95 % bands."""
    figure, axes = new_figure(8.6, 5.6, 2, 1, sharex=True, height_ratios=(2, 1))
    rows = (("circulation", 1e4, "circulation, cm²/s"), ("radius", MM, "radius, mm"))
    for ax, (name, unit, label) in zip(axes, rows, strict=True):
        for source, fingers in tracks.items():
            for finger, track in enumerate(fingers):
                line = {
                    "label": finger_name(source, finger, len(fingers)),
                    "color": COLOURS[source],
                    "linestyle": ("-", "--")[finger],
                }
                _banded(ax, broken(track, "track"), name, unit, line)
        ax.axvspan(*middle, label="middle of the stroke", **_MIDDLE)
        ax.set_ylabel(label)
    axes[0].set_title("Tip vortex over time (counter-clockwise positive)")
    axes[0].legend(loc="best")
    axes[1].set_xlabel("time, s")
    return figure


def finger_name(source: str, finger: int, fingers: int) -> str:
    """A legend's entry: the source, and which finger where there are two."""
    return NAMES[source] + (f", {('left', 'right')[finger]} finger" if fingers > 1 else "")


def _has_std(track: pd.DataFrame, name: str) -> bool:
    return f"{name}_std" in track and bool((track[f"{name}_std"] > 0).any())


def _banded(ax, track: pd.DataFrame, name: str, unit: float, line: dict[str, Any]) -> None:
    ax.plot(track["time"], track[name] * unit, **line)
    if _has_std(track, name):
        half = BAND * track[f"{name}_std"].to_numpy(float)
        low, high = (track[name] - half) * unit, (track[name] + half) * unit
        ax.fill_between(track["time"], low, high, color=line["color"], alpha=0.2, linewidth=0)


def has_band(tracks: Tracks) -> list[str]:
    """Sources whose vortex table carries an uncertainty of the circulation."""
    return [source for source, (track, *_) in tracks.items() if _has_std(track, "circulation")]


def paths(tracks: Tracks, plane: xr.Dataset, middle: tuple[float, float]) -> Figure:
    """Paths of vortex centres and tip over the outline at the first, middle and last instant."""
    figure, ax = new_figure(6.6, 5.6)
    times = plane["time"].values
    instants = [0, int(np.argmin(np.abs(times - np.mean(middle)))), times.size - 1]
    way = {"color": GREY, "ls": "--", "linewidth": 1.2}
    for number in range(plane.sizes["finger"]):
        for index, tone in zip(instants, ("0.85", "0.6", "0.15"), strict=True):
            outline = plane["outline"].values[index, number].T * MM
            ax.fill(*outline, facecolor=tone, edgecolor="none")
        tip = plane["tip"].values[:, number].T * MM
        ax.plot(*tip, label=None if number else "tip", **way)
    for source, fingers in tracks.items():
        for finger, track in enumerate(fingers):
            _path(ax, track, middle, source, None if finger else f"vortex, {NAMES[source]}")
    ax.set(aspect="equal", xlabel="x, mm", ylabel="y, mm", title="Where the vortex goes")
    ax.legend(loc="best")
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


def agreement(series: pd.DataFrame, scale: float, middle: tuple[float, float]) -> Figure:
    """Velocity difference, correlation and distance of the vortex centres of PIV and CFD."""
    figure, axes = new_figure(8.6, 6.0, 3, 1, sharex=True)
    time, correlation = series["time"], series["velocity_correlation"]
    axes[0].plot(time, series["velocity_rms_difference"] / scale * 100, color=PIV)
    axes[0].set(ylabel="RMS difference,\n% of tip speed", title="PIV against CFD over time")
    axes[1].plot(time, correlation, color=PIV)
    axes[1].set(ylabel="correlation, 1", ylim=(min(0.8, correlation.min()), 1.005))
    if "centre_distance" in series:
        axes[2].plot(time, series["centre_distance"] * MM, color=PIV)
    axes[2].set(ylabel="distance of\ncentres, mm", xlabel="time, s")
    for ax in axes[::2]:
        ax.set_ylim(0, None)
    for ax in axes:
        ax.axvspan(*middle, **_MIDDLE)
    return figure


def motion(rows: list[tuple[np.ndarray, np.ndarray, str]]) -> Figure:
    """What drives the flow: one panel for each (time in s, values, label with its unit)."""
    figure, axes = new_figure(8.6, 0.4 + 4.8 * len(rows) / 3, len(rows), 1, sharex=True)
    for ax, (t, values, label) in zip(axes, rows, strict=True):
        ax.plot(t, values, color=CFD)
        ax.set_ylabel(label)
    axes[0].set_title("The motion")
    axes[-1].set_xlabel("time, s")
    return figure


def bending(
    pressure: np.ndarray,
    bend: np.ndarray,
    bend_std: np.ndarray | None,
    paper: np.ndarray,
    length: float,
) -> Figure:
    """Bending radius (mm) over pressure (Pa): states with their band, equations (1)-(6) beside.

    `bend`, `bend_std`, `paper`: (state,) rad; R = `length` / bend (the paper's Figs 7 and 8c).
    """
    figure, ax = new_figure(8.6, 4.2)
    for part in (pressure < -_LEAST_PRESSURE, pressure > _LEAST_PRESSURE):
        if not part.any():
            continue
        name = (lambda label: label) if part[-1] else (lambda label: None)
        kpa = pressure[part] / 1e3
        ax.plot(kpa, length * MM / bend[part], color=CFD, label=name("states"))
        equations = {"color": "0.4", "label": name("equations (1)–(6)")}
        ax.plot(kpa, length * MM / paper[part], "--", **equations)
        if bend_std is not None:
            low, high = (length * MM / (bend[part] + k * bend_std[part]) for k in (-1, 1))
            band = {"color": CFD, "alpha": 0.2, "lw": 0, "label": name("input uncertainty")}
            ax.fill_between(kpa, low, high, **band)
    ax.set(xlabel="pressure, kPa", ylabel="bending radius R, mm", ylim=(-160.0, 160.0))
    ax.set_title("Bending radius over pressure")
    ax.legend(frameon=False)
    return figure
