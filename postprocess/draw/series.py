"""Series over time: vortex, forces, power, the solver's history, mesh quality and costs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from postprocess.draw.style import CFD, COLOURS, GREY, MM, NAMES, PIV, new_figure
from postprocess.evidence.vortex_pairs import broken

BAND = 1.96  # standard deviations to either side: a 95 % band
BESIDE: dict[str, Any] = {
    "loc": "center left",
    "bbox_to_anchor": (1.0, 0.5),
}  # curves fill these pictures


Tracks = dict[str, list[pd.DataFrame]]  # by source, of every finger the tip's vortex over time
STYLES = ("-", "--")  # of the left or only finger, and of the right one


def circulation(tracks: Tracks, middle: tuple[float, float]) -> Figure:
    """Circulation and core radius of every tip's vortex over time with 95 % bands; the middle of the stroke is shaded."""
    figure, axes = new_figure(8.6, 5.6, 2, 1, sharex=True, height_ratios=(2, 1))
    rows = (("circulation", 1e4, "circulation, cm²/s"), ("core_radius", MM, "core radius, mm"))
    for ax, (name, unit, label) in zip(axes, rows, strict=True):
        for source, fingers in tracks.items():
            for finger, track in enumerate(fingers):
                _banded(ax, track, name, unit, source, finger, len(fingers))
        ax.axvspan(*middle, color="#f0e9d8", zorder=0, label="middle of the stroke")
        ax.set_ylabel(label)
    axes[0].set_title("Tip vortex over time (counter-clockwise positive)")
    axes[0].legend(loc="best")
    axes[1].set_xlabel("time, s")
    return figure


def finger_name(source: str, finger: int, fingers: int) -> str:
    """A legend's entry: the source, and which finger where there are two."""
    return NAMES[source] + (f", {('left', 'right')[finger]} finger" if fingers > 1 else "")


def _banded(
    ax, track: pd.DataFrame, name: str, unit: float, source: str, finger: int, fingers: int
) -> None:
    colour, label = COLOURS[source], finger_name(source, finger, fingers)
    track = broken(track, "track")
    ax.plot(track["time"], track[name] * unit, color=colour, linestyle=STYLES[finger], label=label)
    std = track.get(f"{name}_std")
    if std is not None and np.any(std.to_numpy(float) > 0):
        half = BAND * std.to_numpy(float)
        low, high = (track[name] - half) * unit, (track[name] + half) * unit
        ax.fill_between(track["time"], low, high, color=colour, alpha=0.2, linewidth=0)


def has_band(tracks: Tracks) -> list[str]:
    """Sources whose vortex table carries an uncertainty of the circulation."""
    return [
        s
        for s, (t, *_) in tracks.items()
        if "circulation_std" in t and np.any(t["circulation_std"].to_numpy(float) > 0)
    ]


def paths(tracks: Tracks, plane: xr.Dataset, middle: tuple[float, float]) -> Figure:
    """Paths of the vortex centres and of the tip over the finger's outline at first, middle and last instant."""
    figure, ax = new_figure(6.6, 5.6)
    times = plane["time"].values
    instants = [0, int(np.argmin(np.abs(times - np.mean(middle)))), times.size - 1]
    for number in range(plane.sizes["finger"]):
        for index, tone in zip(instants, ("0.85", "0.6", "0.15"), strict=True):
            ax.fill(
                *(plane["outline"].values[index, number].T * MM), facecolor=tone, edgecolor="none"
            )
        label = "tip" if number == 0 else None
        ax.plot(
            *(plane["tip"].values[:, number].T * MM),
            color=GREY,
            ls="--",
            linewidth=1.2,
            label=label,
        )
    for source, fingers in tracks.items():
        for finger, track in enumerate(fingers):
            _path(ax, track, middle, source, f"vortex, {NAMES[source]}" if finger == 0 else None)
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
        half = BAND * some[["x_std", "y_std"]] * MM
        ax.errorbar(
            some["x"] * MM,
            some["y"] * MM,
            half["y_std"],
            half["x_std"],
            fmt="none",
            ecolor=colour,
            alpha=0.7,
        )


def agreement(series: pd.DataFrame, scale: float, middle: tuple[float, float]) -> Figure:
    """Velocity difference, correlation and distance of the vortex centres between PIV and CFD over time."""
    figure, axes = new_figure(8.6, 6.0, 3, 1, sharex=True)
    axes[0].plot(series["time"], series["velocity_rms_difference"] / scale * 100, color=PIV)
    axes[0].set(
        ylabel="RMS difference,\n% of tip speed", ylim=(0, None), title="PIV against CFD over time"
    )
    axes[1].plot(series["time"], series["velocity_correlation"], color=PIV)
    axes[1].set(
        ylabel="correlation, 1", ylim=(min(0.8, series["velocity_correlation"].min()), 1.005)
    )
    if "centre_distance" in series:
        axes[2].plot(series["time"], series["centre_distance"] * MM, color=PIV)
    axes[2].set(ylabel="distance of\ncentres, mm", ylim=(0, None), xlabel="time, s")
    for ax in axes:
        ax.axvspan(*middle, color="#f0e9d8", zorder=0)
    return figure


LEAST_PRESSURE = 3e3  # Pa; below it R runs off to infinity


def motion(rows: list[tuple[np.ndarray, np.ndarray, str]]) -> Figure:
    """What drives the flow: one panel for each (time in s, values, label with its unit)."""
    figure, axes = new_figure(8.6, 0.4 + 4.8 * len(rows) / 3, len(rows), 1, sharex=True)
    for ax, (t, values, label) in zip(axes, rows, strict=True):
        ax.plot(t, values, color=CFD)
        ax.set_ylabel(label)
    axes[0].set_title("The motion that is prescribed")
    axes[-1].set_xlabel("time, s")
    return figure


def bending(
    pressure: np.ndarray,
    bend: np.ndarray,
    bend_std: np.ndarray | None,
    paper: np.ndarray,
    length: float,
) -> Figure:
    """Bending radius (mm) over pressure (Pa): states with the band of their input uncertainty, equations (1)-(6) beside.

    `bend`, `bend_std`, `paper`: (state,) rad; R = `length` / bend (the paper's Figs 7 and 8c).
    """
    figure, ax = new_figure(8.6, 4.2)
    shown = 80.0
    for part in (pressure < -LEAST_PRESSURE, pressure > LEAST_PRESSURE):
        if not part.any():
            continue
        kpa = pressure[part] / 1e3
        (line,) = ax.plot(kpa, length * MM / bend[part], color=CFD)
        (equations,) = ax.plot(kpa, length * MM / paper[part], "--", color="0.4")
        line.set_label("states" if part[-1] else None)
        equations.set_label("equations (1)–(6)" if part[-1] else None)
        if bend_std is not None:
            low, high = (length * MM / (bend[part] + k * bend_std[part]) for k in (-1, 1))
            ax.fill_between(
                kpa,
                low,
                high,
                color=CFD,
                alpha=0.2,
                lw=0,
                label="input uncertainty" if part[-1] else None,
            )
    ax.set(xlabel="pressure, kPa", ylabel="bending radius R, mm", ylim=(-2 * shown, 2 * shown))
    ax.set_title("Bending radius over pressure")
    ax.legend(frameon=False)
    return figure
