"""The flow around the finger as in the paper's Fig. 10: vectors, finger, vortex with its sense."""

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

_AROUND = 0.020  # m shown beside the tips' and the vortices' way
_ARROW_EVERY = 0.0045  # m between drawn vectors: about 35 of them across the camera's picture
_HALO = [patheffects.withStroke(linewidth=4.0, foreground="white")]
# Behind the body.
_MARK: dict[str, Any] = {"color": "#0a7d2c", "linewidth": 2.0, "zorder": 2, "path_effects": _HALO}
_OTHER: dict[str, Any] = _MARK | {"color": "#4b5561", "linewidth": 1.0}
_MARKED = ["x", "y", "radius", "circulation"]
_RIVAL = 0.3  # of the strongest at that instant: what is weaker is not marked
_SHADE: dict[str, Any] = {
    "origin": "lower",
    "cmap": COLOUR_MAP,
    "alpha": 0.75,
    "interpolation": "bilinear",
}
_ARROWS: dict[str, Any] = {
    "units": "xy",
    "angles": "xy",
    "scale_units": "xy",
    "color": "#1c2733",
    "width": 0.5,
    "headwidth": 3.4,
    "headlength": 4,
}


def view_limits(planes: dict[str, xr.Dataset], vortices: dict[str, list[pd.DataFrame]]) -> list:
    """x0, x1, y0, y1 (m) of the region that all planes see near the tips and the vortices."""
    limits = []
    for number, axis in enumerate(("x", "y")):
        low = max(float(p[axis][0]) for p in planes.values())
        high = min(float(p[axis][-1]) for p in planes.values())
        at = [p["tip"].values[..., number].ravel() for p in planes.values() if "tip" in p]
        for track in (track for fingers in vortices.values() for track in fingers):
            at += [track[axis] - track["radius"], track[axis] + track["radius"]]
        known = np.concatenate(at) if at else np.array([low, high])
        limits += [max(low, float(known.min()) - _AROUND), min(high, float(known.max()) + _AROUND)]
    return limits


def vorticity(field: np.ndarray, valid: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """∂v/∂x − ∂u/∂y (1/s) by central differences, not a number next to invalid points."""
    u, v = np.where(valid, field, np.nan)
    return np.gradient(v, x, axis=1) - np.gradient(u, y, axis=0)


def vorticity_limit(plane: xr.Dataset, times: np.ndarray) -> float:
    """A rounded colour limit (1/s): the 99.5th percentile of |vorticity| at the instants."""
    x, y = plane["x"].values, plane["y"].values
    fields = (vorticity(*frame(plane, _nearest(plane, time)), x, y) for time in times)
    worst = max(float(np.nanpercentile(np.abs(field), 99.5)) for field in fields)
    return float(np.ceil(worst / 5) * 5) or 1.0


def _nearest(plane: xr.Dataset, time: float) -> int:
    """Index of the instant closest to `time`."""
    return int(np.argmin(np.abs(plane["time"].values - time)))


def _vortex_mark(x: float, y: float, radius: float, circulation: float) -> np.ndarray:
    """A circle (2, points) with two arrow heads that show the sense, and a gap at its end."""
    sense = 1.0 if circulation > 0 else -1.0
    angle = np.linspace(0, 2 * np.pi, 49)
    parts = [np.stack([np.cos(angle), np.sin(angle)])]
    gap = np.full(2, np.nan)
    for start in (0.0, np.pi):
        tip = np.array([np.cos(start), np.sin(start)])
        along = sense * np.array([-np.sin(start), np.cos(start)])
        for side in (0.3, -0.3):
            parts.append(np.stack([gap, tip - 0.42 * along + side * tip, tip], axis=1))
    mark = np.array([[x], [y]]) + radius * np.concatenate(parts, axis=1)
    return np.append(mark, gap[:, None], axis=1)


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

    `vortices`: by source each finger's tip vortex over time; `scale`: velocity scale, m/s;
    `limit`: of the vorticity, 1/s; `panel`: width of a panel, inches. The other vortices of
    `tables` are marked by thin circles.
    """
    x0, x1, y0, y1 = view_limits(planes, vortices)
    height = panel * (y1 - y0) / (x1 - x0) + 0.8
    more: dict[str, Any] = {"dpi": dpi, "sharey": True, "squeeze": False}
    figure, axes = new_figure(panel * len(planes) + 0.9, height, 1, len(planes), **more)
    updates = []
    for ax, (source, plane) in zip(axes[0], planes.items(), strict=True):
        table = (tables or {}).get(source)
        shade, update = _panel(ax, plane, vortices.get(source, []), table, scale, limit)
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
            # PIV has fewer instants than the sheet.
            shown = float(plane["time"][_nearest(plane, time)])
            ax.set_title(f"{NAMES[source]}, {format_instant(plane, shown)}")
            update(shown)

    return figure, show


def format_instant(plane: xr.Dataset, time: float) -> str:
    """An instant (s) with the bend of the first finger then."""
    bends = plane["bend"].values[:, 0] if "bend" in plane else np.zeros(1)
    if np.ptp(bends) <= REST:
        return f"{time:.3f} s"
    return f"{time:.3f} s, bent by {np.degrees(np.interp(time, plane['time'].values, bends)):.0f}°"


def others(table: pd.DataFrame, judged: list[pd.DataFrame], time: float) -> pd.DataFrame:
    """The strong vortices of an instant (s) that are not `judged`."""
    now = table[np.isclose(table["time"], time, atol=1e-6)]
    known = [track for vortex in judged for track in vortex["track"].unique()]
    strong = now["circulation"].abs() >= _RIVAL * now["circulation"].abs().max()
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
    every = max(1, round(_ARROW_EVERY / dx))
    rows, columns = np.arange(every // 2, y.size, every), np.arange(every // 2, x.size, every)
    extent = np.array([x[0] - dx / 2, x[-1] + dx / 2, y[0] - dy / 2, y[-1] + dy / 2]) * MM
    blank = np.full((y.size, x.size), np.nan)
    shade = ax.imshow(blank, extent=extent, vmin=-limit, vmax=limit, **_SHADE)
    gx, gy = np.meshgrid(x[columns] * MM, y[rows] * MM)
    hidden = np.ma.masked_all(gx.shape)
    # 45 % of the tip's peak speed reaches to the next vector.
    unit = 0.45 * scale / (every * dx * MM)
    arrows = ax.quiver(gx, gy, hidden, hidden, scale=unit, **_ARROWS)
    known = float(f"{0.5 * scale:.1g}")
    beside = {"labelpos": "E", "coordinates": "axes", "fontproperties": {"size": 9}}
    ax.quiverkey(arrows, 0.8, 1.03, known, f"{known:g} m/s", **beside)
    fingers = range(plane.sizes.get("finger", 0) if "outline" in plane else 0)
    bodies = [ax.fill([], [], color="black", zorder=3)[0] for _ in fingers]
    (beside_them,) = ax.plot([], [], **_OTHER)
    marks = [ax.plot([], [], **_MARK)[0] for _ in vortices]

    def update(time: float) -> None:
        index = _nearest(plane, time)
        field, valid = frame(plane, index)
        shade.set_data(vorticity(field, valid, x, y))
        drawn = np.ma.masked_array(field, mask=np.broadcast_to(~valid, field.shape))
        arrows.set_UVC(*drawn[:, rows[:, None], columns])
        for number, body in enumerate(bodies):
            body.set_xy(plane["outline"].values[index, number] * MM)

        def marked(places: np.ndarray) -> np.ndarray:
            """Marks of vortices (n, _MARKED) where there is a vector, as one broken line in mm."""
            at = [
                np.clip(np.rint((places[:, k] - axis[0]) / step).astype(int), 0, axis.size - 1)
                for k, axis, step in ((1, y, dy), (0, x, dx))
            ]
            shown = places[valid[tuple(at)]] * [MM, MM, MM, 1.0]
            return np.concatenate([np.empty((2, 0)), *(_vortex_mark(*p) for p in shown)], axis=1)

        if table is not None:
            rest = others(table, vortices, float(plane["time"][index]))
            beside_them.set_data(*marked(rest[_MARKED].to_numpy()))
        for mark, vortex in zip(marks, vortices, strict=True):
            mark.set_data(*marked(_at(vortex, time)))

    return shade, update


def _at(vortex: pd.DataFrame, time: float) -> np.ndarray:
    """A vortex (1, `_MARKED`) between the two rows around `time`; none outside of them."""
    times = vortex["time"].to_numpy()
    after = int(np.clip(np.searchsorted(times, time), 1, max(times.size - 1, 1)))
    if times.size < 2 or not times[after - 1] - 2e-3 <= time <= times[after] + 2e-3:
        return np.empty((0, len(_MARKED)))
    rows = vortex.iloc[after - 1 : after + 1]
    if rows["track"].nunique() > 1:  # of two vortices: the nearer row
        rows = rows.iloc[[int(np.argmin(np.abs(rows["time"].to_numpy() - time)))] * 2]
    return np.array([[float(np.interp(time, rows["time"], rows[n])) for n in _MARKED]])
