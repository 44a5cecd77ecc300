"""Pressure in the sheet from PIV beside the simulation's, and the loads of both."""

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from postprocess.draw.series import BAND
from postprocess.draw.style import BODY, COLOURS, MM, NAMES, WIDTH

_TALL = 7.6  # inches, as the figure beside it
_AROUND = 0.03  # m shown beside the tip's way


def pressure_and_loads(
    planes: dict[str, xr.Dataset], on_outline: dict[str, np.ndarray], loads: pd.DataFrame
) -> Figure:
    """Maps of `p` (Pa) at one instant, its course along the outline, the moment over time.

    planes: that instant of each source. on_outline: (point,) Pa. loads: as `load_table` gives them.
    """
    known = bool(np.isfinite(loads["moment_piv"]).any())
    height = _TALL if known else 0.7 * _TALL
    figure = Figure(figsize=(WIDTH, height), dpi=160, layout="constrained")
    rows: list[Any] = [["cfd", "piv"], ["along"] * 2, *([["moment"] * 2] if known else [])]
    axes = figure.subplot_mosaic(rows, height_ratios=[1.6, 1, 1][: len(rows)])
    size = float(np.nanpercentile(np.abs(planes["cfd"]["p"].values), 99.5))
    maps = [_map(axes[source], plane, size, NAMES[source]) for source, plane in planes.items()]
    figure.colorbar(maps[0], ax=[axes[s] for s in planes], label="pressure, Pa", shrink=0.8)
    axes["cfd"].set_ylabel("y, mm")
    way = _from_tip(planes["piv"]) * MM
    order = np.argsort(way)
    for source, pressure in on_outline.items():
        line: dict[str, Any] = {"color": COLOURS[source], "label": NAMES[source]}
        axes["along"].plot(way[order], pressure[order], **line)
        if known:
            axes["moment"].plot(loads["time"], loads[f"moment_{source}"], **line)
    xlabel, title = "way along the outline from the tip (dorsal > 0), mm", "On the finger, then"
    axes["along"].set(xlabel=xlabel, ylabel="pressure, Pa", title=title)
    axes["along"].legend(loc="best")
    if known:
        std = BAND * loads["moment_piv_std"]
        sides = loads["moment_piv"] - std, loads["moment_piv"] + std
        band: dict[str, Any] = {"color": COLOURS["piv"], "alpha": 0.2, "linewidth": 0}
        axes["moment"].fill_between(loads["time"], *sides, **band)
        axes["moment"].set(xlabel="time, s", ylabel="N m per m width", title="Moment at the root")
    return figure


def _map(axis, plane: xr.Dataset, size: float, name: str) -> Any:
    x, y, tip = plane["x"].values, plane["y"].values, plane["tip"].values[0]
    root = plane["outline"].values[0][:, 1].max()
    grid = axis.pcolormesh(
        x * MM, y * MM, plane["p"].values, cmap="RdBu_r", vmin=-size, vmax=size, rasterized=True
    )
    axis.fill(*(plane["outline"].values[0].T * MM), color=BODY)
    axis.set(aspect="equal", xlabel="x, mm", title=f"Pressure, {name}")
    wide = 0.5 * (root - tip[1]) + _AROUND
    axis.set_xlim((tip[0] - wide) * MM, (tip[0] + wide) * MM)
    axis.set_ylim((tip[1] - _AROUND) * MM, (root + 0.3 * _AROUND) * MM)
    axis.grid(False)
    return grid


def _from_tip(plane: xr.Dataset) -> np.ndarray:
    """Way (point,) m of the outline's points from the tip, on the dorsal side positive."""
    outline, tip = plane["outline"].values[0], plane["tip"].values[0]
    steps = np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)[:-1]])
    middle = int(np.argmin(np.linalg.norm(outline - tip, axis=1)))
    round_ = float(steps.sum())
    way = (way - way[middle] + 0.5 * round_) % round_ - 0.5 * round_
    dorsal = (outline - tip) @ plane["dorsal_direction"].values[0]
    near = np.abs(way) < 0.1 * round_
    return way * (1.0 if np.sum(way[near] * dorsal[near]) > 0 else -1.0)
