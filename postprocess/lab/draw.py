"""Figures of a comparison with a laboratory: time series, motion and flow."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.formats.kinematics import Kinematics
from piv.formats.plane_series import usable
from postprocess.draw.flow import flow_figure, view_limits, vorticity_limit
from postprocess.draw.style import CFD, GREY, LAB, PIV, SHADED, new_figure
from postprocess.lab.fit_outline import law_pressure
from postprocess.lab.pose import Pose
from postprocess.lab.register import Registration
from postprocess.lab.virtual_experiment import Sides

COLOUR = {"data": LAB, "virtual": PIV, "corrected": PIV, "direct": CFD}
NAME = {"data": "laboratory (DPIV)", "virtual": "simulation, seen by the same PIV"}
NAME["direct"] = "simulation, direct"
NAME["corrected"] = (
    "simulation S: seen by the same PIV, with finer numerics, at the recorded motion"
)
K95 = 1.96


def series(table: pd.DataFrame, circulation: dict[str, Any]) -> Figure:
    """Circulation over time with 95 % bands of each instant on both sides: D and S of the table."""
    figure, ax = new_figure(8.8, 4.4)
    instant, unit = circulation["instant"], 1e4
    half = {"data": instant["data"][0], "corrected": instant["simulation"][0]}
    for side in ("direct", "corrected", "data"):
        values, time = table[f"circulation_{side}"], table["time"]
        line = ":" if side == "direct" else "-"
        ax.plot(time, values * unit, line, color=COLOUR[side], label=NAME[side])
        if side in half:
            low, high = ((values + s * K95 * half[side]) * unit for s in (-1, 1))
            ax.fill_between(time, low, high, color=COLOUR[side], alpha=0.2, lw=0)
    ax.axvspan(*circulation["window"], color=SHADED, zorder=0)
    ax.set(xlabel="time of the simulation, s", ylabel="circulation, cm²/s")
    ax.set_title("Tip vortex (shaded: the instants compared); bands hold 95 % of each instant")
    ax.legend(loc="best")
    return figure


def motion(kinematics: Kinematics, registration: Registration) -> Figure:
    """Bend angle over time: simulation, fitted law, and what single frames show."""
    figure, ax = new_figure(8.8, 3.8)
    law, times = registration.law, np.linspace(*kinematics.time, 200)
    recorded = law_pressure(kinematics, times + law.delay, law.values)
    for pressures, colour, name in (
        (kinematics.law(times), CFD, "simulation"),
        (recorded, LAB, "recording, fitted law"),
    ):
        ax.plot(times, np.degrees(kinematics.bend(pressures)), color=colour, label=name)
    seen = np.degrees(kinematics.bend(registration.pressures))
    if seen.size:
        at = registration.times - law.delay
        ax.plot(at, seen, ".", color=GREY, ms=5, label="recording, single frames")
    found = f"factor {law.values[0]:.3f}, duration × {law.values[2]:.3f}"
    ax.set(xlabel="time of the simulation, s", ylabel="bend angle, °")
    ax.set_title(f"Motion of the finger ({found})")
    ax.legend(loc="best")
    return figure


def difference(sides: Sides) -> Figure:
    """|u_S − u_D| over the fastest water of the recording, at a quarter, half and the end."""
    figure, axes = new_figure(8.8, 3.3, 1, 3, sharey=True)
    data, ours, count = sides.data, sides.virtual, sides.data.sizes["time"]
    ok = usable(data).values & usable(ours).values
    apart = np.hypot(*(ours[n].values - data[n].values for n in ("u", "v")))
    fastest = np.nanquantile(np.hypot(data["u"].values, data["v"].values), 0.999)
    x, y = (1e3 * data[n].values for n in ("x", "y"))
    for ax, k in zip(axes, (count // 4, count // 2, count - 1), strict=True):
        values = np.where(ok[k], 100 * apart[k] / fastest, np.nan)
        shade = ax.pcolormesh(x, y, values, vmin=0, vmax=20, cmap="YlOrBr", rasterized=True)
        for plane, colour in ((data, LAB), (ours, PIV)):
            for outline in plane["outline"].values[k]:
                ax.plot(*(1e3 * np.vstack([outline, outline[:1]]).T), color=colour, lw=1)
        ax.set(title=f"{data['time'].values[k]:.3f} s", xlabel="x, mm", aspect="equal")
    axes[0].set_ylabel("y, mm")
    figure.colorbar(shade, ax=list(axes), shrink=0.85, label="% of the fastest water")
    return figure


def flow(sides: Sides, table: pd.DataFrame, pose: Pose, time: float) -> np.ndarray:
    """Measured beside simulated vectors at the instant next to `time` (s), (row, column, RGB)."""
    planes, vortices = {}, {}
    for side, plane in (("data", sides.data), ("virtual", sides.virtual)):
        columns = ("circulation", "x", "y", "radius")
        track = table[[f"{name}_{side}" for name in columns]].set_axis(columns, axis=1)
        track = track.assign(time=table["time"], track=0).dropna()
        x, y = pose.to_camera(track[["x", "y"]].to_numpy()).T
        planes[NAME[side]], vortices[NAME[side]] = plane, [track.assign(x=x, y=y)]
    speed = float(np.nanquantile(np.hypot(sides.data["u"].values, sides.data["v"].values), 0.999))
    limit = vorticity_limit(sides.data, np.array([time]))
    view = view_limits(planes, vortices)
    return flow_figure(planes, vortices, speed, limit, view)(time)
