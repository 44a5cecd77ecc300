"""The flow around the finger in the manner of the paper's Fig. 10: vectors, black finger, vortex with its sense."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib import patheffects
from matplotlib.figure import Figure

from piv.plots.vectors import COLOUR_MAP
from postprocess.draw.style import MM, NAMES, new_figure
from postprocess.evidence.fields import frame
from postprocess.evidence.strokes import REST

AROUND = 0.020  # m shown beside the tips' and the vortices' way
ARROW_EVERY = 0.0045  # m between drawn vectors: about 35 of them across the camera's picture
HALO = [patheffects.withStroke(linewidth=4.0, foreground="white")]
MARK: dict[str, Any] = {
    "color": "#0a7d2c",
    "linewidth": 2.0,
    "zorder": 2,
    "path_effects": HALO,
}  # behind the body
OTHER: dict[str, Any] = MARK | {"color": "#4b5561", "linewidth": 1.0}
MARKED = ("x", "y", "core_radius", "circulation")
RIVAL = 0.3  # of the strongest at that instant: what is weaker is not marked
SHADE: dict[str, Any] = {
    "origin": "lower",
    "cmap": COLOUR_MAP,
    "alpha": 0.75,
    "interpolation": "bilinear",
}
ARROWS: dict[str, Any] = {"units": "xy", "angles": "xy", "scale_units": "xy", "width": 0.5, "headwidth": 3.4, "headlength": 4,
                          "color": "#1c2733"}  # fmt: skip


def view_limits(
    planes: dict[str, xr.Dataset], vortices: dict[str, list[pd.DataFrame]]
) -> tuple[float, float, float, float]:
    """What the figure shows: x from, x to, y from, y to (m).

    What all planes see, and of that what lies within `AROUND` of the tips and of the vortices' cores at any instant.
    """
    limits = []
    for number, axis in enumerate(("x", "y")):
        low = max(float(p[axis][0]) for p in planes.values())
        high = min(float(p[axis][-1]) for p in planes.values())
        at = [p["tip"].values[..., number].ravel() for p in planes.values() if "tip" in p]
        for track in (track for fingers in vortices.values() for track in fingers):
            at += [track[axis] - track["core_radius"], track[axis] + track["core_radius"]]
        known = np.concatenate(at) if at else np.array([low, high])
        limits += [max(low, float(known.min()) - AROUND), min(high, float(known.max()) + AROUND)]
    return limits[0], limits[1], limits[2], limits[3]


def vorticity(field: np.ndarray, valid: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """∂v/∂x − ∂u/∂y (1/s) by central differences, not a number next to invalid points."""
    u, v = np.where(valid, field, np.nan)
    return np.gradient(v, x, axis=1) - np.gradient(u, y, axis=0)


def vorticity_limit(plane: xr.Dataset, times: np.ndarray) -> float:
    """A symmetric colour limit (1/s), rounded: the 99.5th percentile of |vorticity| at the given instants."""
    x, y = plane["x"].values, plane["y"].values
    worst = 0.0
    for time in times:
        field, valid = frame(plane, nearest(plane, time))
        worst = max(worst, float(np.nanpercentile(np.abs(vorticity(field, valid, x, y)), 99.5)))
    return float(np.ceil(worst / 5) * 5) or 1.0


def nearest(plane: xr.Dataset, time: float) -> int:
    """Index of the instant closest to `time`."""
    return int(np.argmin(np.abs(plane["time"].values - time)))


def vortex_mark(
    x: float, y: float, radius: float, circulation: float
) -> tuple[np.ndarray, np.ndarray]:
    """A circle with two arrow heads that show the sense of rotation; lengths in the unit of `radius`."""
    sense = 1.0 if circulation > 0 else -1.0
    angle = np.linspace(0, 2 * np.pi, 49)
    xs, ys = [np.cos(angle)], [np.sin(angle)]
    for start in (0.0, np.pi):
        tip = np.array([np.cos(start), np.sin(start)])
        along = sense * np.array([-np.sin(start), np.cos(start)])
        for side in (0.3, -0.3):
            back = tip - 0.42 * along + side * tip
            xs.append(np.array([np.nan, back[0], tip[0]]))
            ys.append(np.array([np.nan, back[1], tip[1]]))
    return x + radius * np.concatenate(xs), y + radius * np.concatenate(ys)


def flow_figure(
    planes: dict[str, xr.Dataset],
    vortices: dict[str, list[pd.DataFrame]],
    scale: float,
    limit: float,
    *,
    tables: dict[str, pd.DataFrame] | None = None,
    dpi: float = 110,
    panel: float = 5.0,
) -> tuple[Figure, Callable[[float], None]]:
    """A figure with one panel per source, and the function that shows an instant (s) in it.

    `vortices` holds each source's tip vortex of every finger over time, `scale` the velocity scale (m/s), `limit` the
    vorticity limit (1/s), `panel` the width of a panel (inches): the narrower it is, the larger letters appear. Of `tables`, all
    vortices by source, those that are not judged are marked by thin circles.
    """
    x0, x1, y0, y1 = view_limits(planes, vortices)
    height = panel * (y1 - y0) / (x1 - x0) + 0.8
    figure, axes = new_figure(
        panel * len(planes) + 0.9, height, 1, len(planes), dpi=dpi, sharey=True, squeeze=False
    )
    updates = []
    shade = None
    for ax, (source, plane) in zip(axes[0], planes.items(), strict=True):
        shade, update = _panel(
            ax, plane, vortices.get(source, []), (tables or {}).get(source), scale, limit
        )
        ax.set(xlim=(x0 * MM, x1 * MM), ylim=(y0 * MM, y1 * MM), aspect="equal", xlabel="x, mm")
        ax.set_title(NAMES[source])
        ax.grid(False)
        updates.append(update)
    axes[0, 0].set_ylabel("y, mm")
    bar = figure.colorbar(shade, ax=list(axes[0]), shrink=0.85, pad=0.01, aspect=30)
    bar.set_label("vorticity, 1/s (purple: clockwise)")
    bar.outline.set_visible(False)
    figure.canvas.draw()
    figure.set_layout_engine("none")  # laid out once: every further frame only moves what moves

    def show(time: float) -> None:
        for ax, (source, plane), update in zip(axes[0], planes.items(), updates, strict=True):
            shown = float(
                plane["time"][nearest(plane, time)]
            )  # PIV has fewer instants than the sheet
            ax.set_title(f"{NAMES[source]}, {format_instant(plane, shown)}")
            update(shown)

    return figure, show


def format_instant(plane: xr.Dataset, time: float) -> str:
    """An instant (s) with the bend of the first finger then, linear in time between the frames around it."""
    bends = plane["bend"].values[:, 0] if "bend" in plane else np.zeros(1)
    if np.ptp(bends) <= REST:
        return f"{time:.3f} s"
    return f"{time:.3f} s, bent by {np.degrees(np.interp(time, plane['time'].values, bends)):.0f}°"


def others(table: pd.DataFrame, judged: list[pd.DataFrame], time: float) -> pd.DataFrame:
    """The vortices of an instant (s) of the table that are not `judged`, without those far weaker than the strongest then."""
    now = table[np.isclose(table["time"], time, atol=1e-6)]
    known = [track for vortex in judged for track in vortex["track"].unique()]
    strong = now["circulation"].abs() >= RIVAL * now["circulation"].abs().max()
    return now[strong & ~now["track"].isin(known)]


def _panel(
    ax,
    plane: xr.Dataset,
    vortices: list[pd.DataFrame],
    table: pd.DataFrame | None,
    scale: float,
    limit: float,
):
    x, y = plane["x"].values, plane["y"].values
    dx, dy = x[1] - x[0], y[1] - y[0]
    every = max(1, round(ARROW_EVERY / dx))
    rows, columns = np.arange(every // 2, y.size, every), np.arange(every // 2, x.size, every)
    extent = np.array([x[0] - dx / 2, x[-1] + dx / 2, y[0] - dy / 2, y[-1] + dy / 2]) * MM
    blank = np.full((y.size, x.size), np.nan)
    shade = ax.imshow(blank, extent=extent, vmin=-limit, vmax=limit, **SHADE)
    gx, gy = np.meshgrid(x[columns] * MM, y[rows] * MM)
    hidden = np.ma.masked_all(gx.shape)
    unit = (
        0.45 * scale / (every * dx * MM)
    )  # 45 % of the tip's peak speed reaches to the next vector
    arrows = ax.quiver(gx, gy, hidden, hidden, scale=unit, **ARROWS)
    known = float(f"{0.5 * scale:.1g}")
    beside = {"labelpos": "E", "coordinates": "axes", "fontproperties": {"size": 9}}
    ax.quiverkey(arrows, 0.8, 1.03, known, f"{known:g} m/s", **beside)
    bodies = [
        ax.fill([], [], color="black", zorder=3)[0] for _ in range(plane.sizes.get("finger", 0))
    ]
    (beside_them,) = ax.plot([], [], **OTHER)
    marks = [ax.plot([], [], **MARK)[0] for _ in vortices]

    def update(time: float) -> None:
        index = nearest(plane, time)
        field, valid = frame(plane, index)
        shade.set_data(vorticity(field, valid, x, y))
        drawn = np.ma.masked_array(field, mask=np.broadcast_to(~valid, field.shape))
        arrows.set_UVC(*drawn[:, rows[:, None], columns])
        for number, body in enumerate(bodies):
            outlines = plane["outline"].values[index] * MM if "outline" in plane else {}
            body.set_xy(outlines[number] if len(outlines) else np.empty((0, 2)))
        seen = seen_centres(plane, valid)
        if table is not None:
            rest = others(table, vortices, float(plane["time"][index]))[list(MARKED)].to_numpy()
            beside_them.set_data(*_marks(rest[seen(rest)]))
        for mark, vortex in zip(marks, vortices, strict=True):
            now = _at(vortex, time)
            mark.set_data(*_marks(now[seen(now)]))

    return shade, update


def seen_centres(plane: xr.Dataset, valid: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """At which of the places (n, x and y first, m) there is a vector: a mark in a hole or a body would be of no flow that one sees."""
    x, y = plane["x"].values, plane["y"].values

    def seen(places: np.ndarray) -> np.ndarray:
        columns, rows = (
            np.clip(
                np.rint((places[:, k] - axis[0]) / (axis[1] - axis[0])).astype(int),
                0,
                axis.size - 1,
            )
            for k, axis in enumerate((x, y))
        )
        return valid[rows, columns]

    return seen


def _marks(vortices: np.ndarray) -> np.ndarray:
    """The marks of vortices (n, `MARKED`) as one broken line, mm: (2, points)."""
    marks = [
        np.append(vortex_mark(x * MM, y * MM, r * MM, c), [[np.nan]] * 2, axis=1)
        for x, y, r, c in vortices
    ]
    return np.concatenate([np.empty((2, 0)), *marks], axis=1)


def _at(vortex: pd.DataFrame, time: float) -> np.ndarray:
    """A vortex (1, `MARKED`) between the two rows around `time`; none outside them, or where they are of two vortices."""
    times = vortex["time"].to_numpy()
    after = int(np.clip(np.searchsorted(times, time), 1, max(times.size - 1, 1)))
    if times.size < 2 or not times[after - 1] - 2e-3 <= time <= times[after] + 2e-3:
        return np.empty((0, len(MARKED)))
    rows = vortex.iloc[after - 1 : after + 1]
    if rows["track"].nunique() > 1:
        rows = rows.iloc[[int(np.argmin(np.abs(rows["time"].to_numpy() - time)))] * 2]
    return np.array([[float(np.interp(time, rows["time"], rows[n])) for n in MARKED]])
