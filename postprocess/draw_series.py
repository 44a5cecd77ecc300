"""Series over time: vortex, forces, power, the solver's history, mesh quality and costs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from postprocess.pairs import broken
from postprocess.style import CFD, COLOURS, GREY, MM, NAMES, PIV, THIRD, new_figure

BAND = 1.96  # standard deviations to either side: a 95 % band
BESIDE: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)}  # curves fill these pictures


Tracks = dict[str, list[pd.DataFrame]]  # by source, of every finger the tip's vortex over time
STYLES = ("-", "--")  # of the left or only finger, and of the right one


def circulation(tracks: Tracks, middle: tuple[float, float]) -> Figure:
    """Circulation and core radius of every tip's vortex over time with 95 % bands; the middle of the stroke is shaded."""
    figure, axes = new_figure(8.6, 5.6, 2, 1, sharex=True, height_ratios=(2, 1))
    for ax, (name, unit, label) in zip(
        axes,
        (("circulation", 1e4, "circulation, cm²/s"), ("core_radius", MM, "core radius, mm")),
        strict=True,
    ):
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


def _banded(ax, track: pd.DataFrame, name: str, unit: float, source: str, finger: int, fingers: int) -> None:
    colour, label = COLOURS[source], finger_name(source, finger, fingers)
    track = broken(track)
    ax.plot(track["time"], track[name] * unit, color=colour, linestyle=STYLES[finger], label=label)
    std = track.get(f"{name}_std")
    if std is not None and np.any(std.to_numpy(float) > 0):
        half = BAND * std.to_numpy(float)
        ax.fill_between(
            track["time"],
            (track[name] - half) * unit,
            (track[name] + half) * unit,
            color=colour,
            alpha=0.2,
            linewidth=0,
        )


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
            ax.fill(*(plane["outline"].values[index, number].T * MM), facecolor=tone, edgecolor="none")
        label = "tip" if number == 0 else None
        ax.plot(*(plane["tip"].values[:, number].T * MM), color=GREY, ls="--", linewidth=1.2, label=label)
    for source, fingers in tracks.items():
        for finger, track in enumerate(fingers):
            _path(ax, track, middle, source, f"vortex, {NAMES[source]}" if finger == 0 else None)
    ax.set(aspect="equal", xlabel="x, mm", ylabel="y, mm", title="Where the vortex goes")
    ax.legend(loc="best")
    return figure


def _path(ax, track: pd.DataFrame, middle: tuple[float, float], source: str, label: str | None) -> None:
    drawn = broken(track)
    ax.plot(
        drawn["x"] * MM,
        drawn["y"] * MM,
        color=COLOURS[source],
        marker=".",
        markersize=4,
        linewidth=1.2,
        label=label,
    )
    inside = track[track["time"].between(*middle)]
    if {"x_std", "y_std"} <= set(track):
        some = inside.iloc[:: max(1, len(inside) // 8)]
        ax.errorbar(
            some["x"] * MM,
            some["y"] * MM,
            BAND * some["y_std"] * MM,
            BAND * some["x_std"] * MM,
            fmt="none",
            ecolor=COLOURS[source],
            alpha=0.7,
        )


def agreement(series: pd.DataFrame, scale: float, middle: tuple[float, float]) -> Figure:
    """Velocity difference, correlation and distance of the vortex centres between PIV and CFD over time."""
    figure, axes = new_figure(8.6, 6.0, 3, 1, sharex=True)
    axes[0].plot(series["time"], series["velocity_rms_difference"] / scale * 100, color=PIV)
    axes[0].set(ylabel="RMS difference,\n% of tip speed", ylim=(0, None), title="PIV against CFD over time")
    axes[1].plot(series["time"], series["velocity_correlation"], color=PIV)
    axes[1].set(ylabel="correlation, 1", ylim=(min(0.8, series["velocity_correlation"].min()), 1.005))
    if "centre_distance" in series:
        axes[2].plot(series["time"], series["centre_distance"] * MM, color=PIV)
    axes[2].set(ylabel="distance of\ncentres, mm", ylim=(0, None), xlabel="time, s")
    for ax in axes:
        ax.axvspan(*middle, color="#f0e9d8", zorder=0)
    return figure


LEAST_PRESSURE = 3e3  # Pa; below it R runs off to infinity


def motion(
    drive_time: np.ndarray, pressure: np.ndarray, time: np.ndarray, bend: np.ndarray, speed: np.ndarray
) -> Figure:
    """Pressure (Pa) over its own time, bend angle (rad) and tip speed (m/s) over the sheet's: what drives the flow."""
    figure, axes = new_figure(8.6, 5.2, 3, 1, sharex=True)
    rows = (
        (drive_time, pressure / 1e3, "pressure, kPa"),
        (time, np.degrees(bend), "bend angle, °"),
        (time, speed, "tip speed, m/s"),
    )
    for ax, (t, values, label) in zip(axes, rows, strict=True):
        ax.plot(t, values, color=CFD)
        ax.set_ylabel(label)
    axes[0].set_title("The motion that is prescribed")
    axes[2].set_xlabel("time, s")
    return figure


def bending(
    pressure: np.ndarray, bend: np.ndarray, bend_std: np.ndarray | None, paper: np.ndarray, length: float
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
                kpa, low, high, color=CFD, alpha=0.2, lw=0, label="input uncertainty" if part[-1] else None
            )
    ax.set(xlabel="pressure, kPa", ylabel="bending radius R, mm", ylim=(-2 * shown, 2 * shown))
    ax.set_title("Bending radius over pressure")
    ax.legend(frameon=False)
    return figure


def forces(table: pd.DataFrame) -> Figure:
    """Force of the water on the finger, total and its viscous part."""
    figure, ax = new_figure(8.6, 3.6)
    for axis, colour in (("x", CFD), ("y", PIV)):
        ax.plot(table["time"], table[f"f{axis}"] * 1e3, color=colour, label=f"force along {axis}")
        ax.plot(
            table["time"],
            table[f"f{axis}_viscous"] * 1e3,
            color=colour,
            linestyle=":",
            label=f"its viscous part, {axis}",
        )
    ax.set(xlabel="time, s", ylabel="force, mN", title="Force of the water on the finger")
    ax.legend(**BESIDE)
    return figure


def power(table: pd.DataFrame) -> Figure:
    """Power balance: rates above, energies with the closure error below."""
    time = table["time"].to_numpy()
    storage = np.gradient(table["kinetic_energy"].to_numpy(), time)
    total = lambda rate: np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))])  # noqa: E731
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
    axes[1].plot(time, (work - gain - lost) * 1e3, color=GREY, linestyle="--", label="closure error")
    axes[1].set(xlabel="time, s", ylabel="energy, mJ")
    for ax in axes:
        ax.legend(**BESIDE)
    return figure


def history(table: pd.DataFrame) -> Figure:
    """Courant number and continuity error over time."""
    figure, axes = new_figure(8.6, 4.6, 2, 1, sharex=True)
    axes[0].plot(table["time"], table["courant_max"], color=CFD, label="largest")
    axes[0].plot(table["time"], table["courant_mean"], color=THIRD, label="mean")
    axes[0].set(ylabel="Courant number, 1", title="Courant number and continuity")
    axes[0].legend()
    for name, colour, label in (("continuity_local", CFD, "local"), ("continuity_global", PIV, "global")):
        size = table[name].abs()
        axes[1].semilogy(table["time"], size.where(size > 0), color=colour, label=label)
    axes[1].set(xlabel="time, s", ylabel="continuity error, 1")
    axes[1].legend()
    return figure


def mesh_quality(table: pd.DataFrame) -> Figure:
    """Non-orthogonality and skewness over the bend angle; a line for each leg of the run."""
    figure, axes = new_figure(8.6, 4.6, 2, 1, sharex=True)
    first = table["leg"].iloc[0]
    lines = (
        (axes[0], "max_non_orthogonality_deg", CFD, "largest"),
        (axes[0], "mean_non_orthogonality_deg", THIRD, "mean"),
        (axes[1], "max_skewness", CFD, "largest skewness"),
        (axes[1], "min_area_ratio", PIV, "smallest area ratio"),
    )
    for ax, column, colour, label in lines:
        for leg, part in table.groupby("leg"):
            ax.plot(part["bend_deg"], part[column], color=colour, label=label if leg == first else None)
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
