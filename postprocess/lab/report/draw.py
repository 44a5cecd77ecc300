"""Pictures of a comparison with a laboratory: fields, significance, series with bands, paths, budgets, registration."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from piv.plots.vectors import COLOUR_MAP
from postprocess.draw.flow import vorticity
from postprocess.draw.style import CFD, GREY, MM, PIV, THIRD, new_figure
from postprocess.evidence.fields import frame
from postprocess.lab.data.pose import Pose

COLOUR = {"data": THIRD, "virtual": PIV, "direct": CFD}
NAME = {
    "data": "laboratory (DPIV)",
    "virtual": "simulation, seen by the same PIV",
    "direct": "simulation, direct",
}
KIND_COLOUR = {"numerical": CFD, "input": PIV, "data": THIRD}
KIND_NAME = {"numerical": "numerical", "input": "inputs", "data": "data"}
K95 = 1.96
THIN: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "width": 0.0022}  # arrows
ARROWS = 26  # across a picture


def fields(
    data: xr.Dataset,
    simulation: xr.Dataset,
    index: int,
    error: np.ndarray,
    significance: np.ndarray,
    k: float,
) -> Figure:
    """Data, simulation, their difference and its significance |E|/u_val at one instant, side by side."""
    figure, axes = new_figure(12.6, 8.6, 2, 2, sharex=True, sharey=True)
    x, y = data["x"].values, data["y"].values
    extent = np.array([x[0], x[-1], y[0], y[-1]]) * MM
    shown = [(plane, *frame(plane, index)) for plane in (data, simulation)]
    curls = [vorticity(field, ok, x, y) for _, field, ok in shown]
    limit = float(np.ceil(np.nanpercentile(np.abs(curls[0]), 99.5) / 5) * 5) or 1.0
    fastest = max(
        float(np.nanpercentile(np.hypot(*np.where(ok, f, np.nan)), 99.5)) for _, f, ok in shown
    )
    every = max(1, x.size // ARROWS)
    cut = (slice(every // 2, None, every),) * 2
    gx, gy = np.meshgrid(x * MM, y * MM)
    style: dict[str, Any] = {"origin": "lower", "extent": extent, "interpolation": "nearest"}
    scale = fastest / (1.6 * every * (x[1] - x[0]) * MM)
    for ax, (plane, field, ok), curl, title in zip(
        axes[0], shown, curls, (NAME["data"], NAME["virtual"]), strict=True
    ):
        shade = ax.imshow(curl, cmap=COLOUR_MAP, vmin=-limit, vmax=limit, alpha=0.8, **style)
        arrows = np.ma.masked_array(field, mask=np.broadcast_to(~ok, field.shape))
        ax.quiver(gx[cut], gy[cut], arrows[0][cut], arrows[1][cut], scale=scale, **THIN)
        _finger(ax, plane, index)
        ax.set_title(title)
    figure.colorbar(shade, ax=list(axes[0]), shrink=0.85, label="vorticity, 1/s")
    size = np.hypot(*error) * 1e3
    top = float(np.nanpercentile(size, 99.5)) or 1.0
    shade = axes[1, 0].imshow(size, cmap="magma_r", vmin=0, vmax=top, **style)
    arrows = np.ma.masked_invalid(error)
    axes[1, 0].quiver(gx[cut], gy[cut], arrows[0][cut], arrows[1][cut], scale=scale / 4, **THIN)
    axes[1, 0].set_title(
        "E: S of the finer runs at the recording's motion, less D (arrows 4 × longer)"
    )
    figure.colorbar(shade, ax=axes[1, 0], shrink=0.85, label="|E|, mm/s")
    shade = axes[1, 1].imshow(significance, cmap="cividis_r", vmin=0, vmax=2 * k, **style)
    axes[1, 1].contour(
        x * MM, y * MM, np.nan_to_num(significance), [k], colors="black", linewidths=0.8
    )
    axes[1, 1].set_title(
        f"significance |E|/u_val (within the line, above {k:.2f}: not explained, at 95 %)"
    )
    figure.colorbar(shade, ax=axes[1, 1], shrink=0.85, label="|E|/u_val")
    for ax in axes[1]:
        _finger(ax, data, index)
    for ax in axes.ravel():
        ax.set(aspect="equal")
        ax.grid(False)
    for ax in axes[1]:
        ax.set_xlabel("x of the camera, mm")
    for ax in axes[:, 0]:
        ax.set_ylabel("y of the camera, mm")
    return figure


def _finger(ax, plane: xr.Dataset, index: int) -> None:
    for outline in plane["outline"].values[index]:
        ax.fill(*(outline.T * MM), color="black", zorder=3)
    ax.set(
        xlim=(plane["x"].values[0] * MM, plane["x"].values[-1] * MM),
        ylim=(plane["y"].values[0] * MM, plane["y"].values[-1] * MM),
    )


def series(
    table: pd.DataFrame, quantities: dict[str, dict[str, Any]], window: tuple[float, float]
) -> Figure:
    """Circulation, core radius and jet speed over time with 95 % bands of each instant on both sides."""
    rows = (
        ("circulation", 1e4, "circulation, cm²/s"),
        ("core_radius", MM, "core radius, mm"),
        ("jet_speed", 1e3, "jet speed, mm/s"),
    )
    figure, axes = new_figure(8.8, 8.0, 3, 1, sharex=True, height_ratios=(2, 1, 1))
    for ax, (name, unit, label) in zip(axes, rows, strict=True):
        q = quantities[name]
        simulated = "virtual" if f"{name}_virtual" in table else "direct"
        half = {
            side: K95 * float(q["u_instant"][of][0])
            for side, of in (("data", "data"), (simulated, "simulation"))
        }
        for side in ("direct", "virtual", "data"):
            if f"{name}_{side}" not in table:
                continue
            values = table[f"{name}_{side}"]
            style = {"linestyle": ":"} if side == "direct" else {}
            ax.plot(table["time"], values * unit, color=COLOUR[side], label=NAME[side], **style)
            if side in half:
                low, high = (values - half[side]) * unit, (values + half[side]) * unit
                ax.fill_between(table["time"], low, high, color=COLOUR[side], alpha=0.2, lw=0)
        ax.axvspan(*window, color="#f0e9d8", zorder=0)
        ax.set_ylabel(label)
    axes[0].set_title(
        "Tip vortex and jet over time, of the nominal run; bands hold 95 % of each instant"
    )
    axes[0].legend(loc="best")
    axes[2].set_xlabel("time of the simulation, s")
    return figure


def paths(
    table: pd.DataFrame,
    direct: xr.Dataset,
    pose: Pose,
    window: tuple[float, float],
    centre: dict[str, Any],
) -> Figure:
    """Vortex paths of both sides over the finger's outline at three instants, tank frame."""
    figure, ax = new_figure(6.8, 6.0)
    times = direct["time"].values
    middle = int(np.argmin(np.abs(times - np.mean(window))))
    for index, tone in ((0, "0.85"), (middle, "0.65"), (times.size - 1, "0.25")):
        ax.fill(
            *(pose.from_camera(direct["outline"].values[index, 0]).T * MM),
            facecolor=tone,
            edgecolor="none",
        )
    for side in ("direct", "virtual", "data"):
        if f"x_{side}" in table:
            ax.plot(
                table[f"x_{side}"] * MM, table[f"y_{side}"] * MM, color=COLOUR[side], marker=".", lw=1.2, label=NAME[side],
                linestyle=":" if side == "direct" else "-",
            )  # fmt: skip
    inside = table[table["time"].between(*window)]
    some = inside.iloc[:: max(1, len(inside) // 6)]
    half = (
        K95
        * np.hypot(*(np.asarray(centre["u_instant"][side]) for side in ("data", "simulation")))
        * MM
    )
    x, y, label = some["x_data"] * MM, some["y_data"] * MM, "95 % of E at an instant"
    ax.errorbar(x, y, half[1], half[0], fmt="none", ecolor=GREY, label=label)
    ax.set(
        aspect="equal",
        xlabel="x, mm",
        ylabel="y, mm",
        title="Paths of the vortex centre, of the nominal run",
    )
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def budgets(quantities: list[dict[str, Any]]) -> Figure:
    """Share of every source in u_val² of each quantity, as bars; the largest sources are named."""
    figure, ax = new_figure(9.2, 0.9 + 0.55 * len(quantities))
    seen = set()
    for row, q in enumerate(quantities):
        parts = [(s["name"], s["kind"], float(np.sum(np.square(s["std"])))) for s in q["sources"]]
        total = sum(p[2] for p in parts) or 1.0
        left = 0.0
        for name, kind, value in sorted(
            parts, key=lambda p: (list(KIND_COLOUR).index(p[1]), -p[2])
        ):
            share = 100 * value / total
            label = KIND_NAME[kind] if kind not in seen else None
            seen.add(kind)
            ax.barh(
                row,
                share,
                left=left,
                color=KIND_COLOUR[kind],
                edgecolor="white",
                label=label,
                height=0.7,
            )
            if share > 9:
                ax.text(
                    left + share / 2, row, name, ha="center", va="center", color="white", fontsize=8
                )
            left += share
    _label_rows(ax, quantities)
    ax.set(xlabel="share of u_val², %", xlim=(0, 100), title="Where the uncertainty comes from")
    ax.legend(loc="upper center", bbox_to_anchor=(0.4, -0.12), ncols=3)
    return figure


def _label_rows(ax, quantities: list[dict[str, Any]]) -> None:
    ax.set_yticks(range(len(quantities)), [q["label"] for q in quantities])
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)


def verdicts(quantities: list[dict[str, Any]]) -> Figure:
    """|E| of every quantity over its u_val without a model error, with the limit k: what is right of the tick is a model error."""
    figure, ax = new_figure(9.2, 0.9 + 0.45 * len(quantities))
    for row, q in enumerate(quantities):
        colour = {"agrees": THIRD, "model error": PIV, "too uncertain": GREY}[q["verdict"]]
        ax.barh(row, q["significance"], color=colour, height=0.6)
        ax.plot([q["k"], q["k"]], [row - 0.38, row + 0.38], color="black", lw=2)
        ax.text(q["significance"], row, f"  {q['verdict']}", va="center", fontsize=9)
    _label_rows(ax, quantities)
    ax.margins(x=0.25)
    ax.set(
        xlabel="|E| / u_val without a model error (black tick: limit at 95 %)",
        title="Difference against its uncertainty",
    )
    return figure


def motion(
    table: pd.DataFrame,
    registration: dict[str, Any],
    data_bend: tuple[np.ndarray, np.ndarray] | None,
) -> Figure:
    """Bend angle over time: the simulation's, the law fitted to the recording, and what single frames show."""
    figure, ax = new_figure(8.8, 3.8)
    ax.plot(table["time"], table["bend_deg_direct"], color=CFD, label="simulation")
    ax.plot(
        table["time"], table["bend_deg_data"], color=THIRD, label="recording, law of motion fitted"
    )
    if data_bend is not None:
        ax.plot(
            data_bend[0],
            np.degrees(data_bend[1]),
            ".",
            color=GREY,
            ms=5,
            label="recording, single frames",
        )
    law = f"factor {registration['pressure_factor']:.3f}, duration × {registration['stretch']:.3f}"
    ax.set(
        xlabel="time of the simulation, s",
        ylabel="bend angle, °",
        title=f"Motion of the finger ({law})",
    )
    ax.legend(loc="best")
    return figure


def overlay(picture: np.ndarray, outlines: dict[str, np.ndarray]) -> Figure:
    """A picture of the recording with outlines (px, y up): the fitted finger and the simulation's."""
    rows, columns = picture.shape
    figure, ax = new_figure(7.6, 7.6 * rows / columns + 0.5)
    ax.imshow(
        picture[::-1],
        origin="lower",
        cmap="gray",
        vmax=float(np.percentile(picture, 99.5)),
        interpolation="nearest",
    )
    for (name, outline), colour in zip(outlines.items(), ("#27c267", "#ff8c42"), strict=False):
        closed = np.vstack([outline, outline[:1]])
        ax.plot(*closed.T, color=colour, lw=1.4, label=name)
    ax.grid(False)
    ax.set(
        xlabel="px",
        ylabel="px",
        xlim=(0, columns),
        ylim=(0, rows),
        title="The finger found in the picture",
    )
    ax.legend(loc="lower right", facecolor="white", frameon=True)
    return figure
