"""The flow around the finger as in the paper's Fig. 10: vectors, finger, vortex with its sense."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib import patheffects
from matplotlib.colors import AsinhNorm
from numpy import ndarray
from scipy.ndimage import minimum_filter

from piv.plots.vectors import COLOUR_MAP, vorticity
from postprocess.draw.animation import pixels
from postprocess.draw.style import BODY, GREY, INK, MM, NAMES, new_figure
from postprocess.evidence.fields import frame
from postprocess.evidence.strokes import REST
from postprocess.words import minus

EDGES = 1.25  # inches of a figure's width beside its panels
_AROUND = 0.016  # m shown beside the fingers and the vortices' way
_ARROW_EVERY = 0.0045  # m between drawn vectors
_STILL = 0.06  # of the scale: slower water has no arrow
_OFF_WALL = 0.003  # m: nearer a wall, its layer would set the colours
_HALO = [patheffects.withStroke(linewidth=4.0, foreground="white")]
# Behind the body.
_MARK: dict[str, Any] = {"color": INK, "zorder": 2, "path_effects": _HALO}
_WEIGHT = (0.7, 1.6)  # points of a judged vortex: at nothing, and added at its strongest
_OTHER: dict[str, Any] = _MARK | {"color": GREY, "linewidth": 1.0}
_LINEAR = 0.15  # of the colours' limit: above it they are compressed, so that weak vortices show
_MARKED = ["x", "y", "radius", "circulation"]
_RIVAL = 0.08  # of the strongest at that instant: the ventral pair of a pinch has 0.097
_SHADE: dict[str, Any] = {"origin": "lower", "interpolation": "bilinear"}
_ARROWS: dict[str, Any] = {
    "units": "xy",
    "angles": "xy",
    "scale_units": "xy",
    "color": INK,
    "width": 0.55,
    "headwidth": 4.0,
    "headlength": 4.5,
    "headaxislength": 4.0,
    "minlength": 0.5,
}
_STRAYS: dict[str, Any] = {"cmap": "YlOrBr", "vmin": 0.0, "vmax": 10.0}  # %, of a difference


def view_limits(planes: dict[str, xr.Dataset], vortices: dict[str, list[pd.DataFrame]]) -> tuple:
    """x0, x1, y0, y1 (m) of the region that all planes see around the fingers and the vortices."""
    limits = []
    for number, axis in enumerate(("x", "y")):
        low = max(float(p[axis][0]) for p in planes.values())
        high = min(float(p[axis][-1]) for p in planes.values())
        at = [p["outline"].values[..., number].ravel() for p in planes.values() if "outline" in p]
        for track in (track for fingers in vortices.values() for track in fingers):
            at += [track[axis] - track["radius"], track[axis] + track["radius"]]
        known = np.concatenate(at) if at else np.array([low, high])
        limits += [max(low, float(known.min()) - _AROUND), min(high, float(known.max()) + _AROUND)]
    return tuple(limits)


def vorticity_limit(plane: xr.Dataset, times: ndarray) -> float:
    """A rounded colour limit (1/s): 99.9 % of the water beside the wall layers turns slower."""
    x, y = plane["x"].values, plane["y"].values
    across = 2 * round(_OFF_WALL / (x[1] - x[0])) + 1
    worst = 0.0
    for time in times:
        field, valid = frame(plane, _nearest(plane, time))
        free = minimum_filter(valid, across, mode="nearest")
        if free.any():
            turning = np.abs(vorticity(field, valid, x, y)[free])
            worst = max(worst, float(np.nanpercentile(turning, 99.9)))
    return float(f"{worst:.1g}") or 1.0


def _nearest(plane: xr.Dataset, time: float) -> int:
    """Index of the instant closest to `time`."""
    return int(np.argmin(np.abs(plane["time"].values - time)))


def _vortex_mark(x: float, y: float, radius: float, circulation: float) -> ndarray:
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
    view: tuple[float, float, float, float],
    *,
    tables: dict[str, pd.DataFrame] | None = None,
    dpi: float = 100,
    panel: float = 5.0,
    rows: int = 1,
    fixed: Sequence[ndarray] = (),
) -> Callable[[float], ndarray]:
    """Draws a panel per source in `rows`; the function returned gives the image of an instant (s).

    `vortices`: by source each finger's tip vortex over time; `scale`: velocity scale, m/s;
    `limit`: of the vorticity, 1/s; `view`: x0, x1, y0, y1 in m; `panel`: width of a panel,
    inches. The other vortices of `tables` are marked by thin circles. The source "difference" is
    coloured by its speed over the scale. `fixed`: outlines (point, 2) of obstacles, m.
    """
    x0, x1, y0, y1 = view
    columns = len(planes) // rows
    height = rows * (panel * (y1 - y0) / (x1 - x0) + 0.35) + 0.5
    more: dict[str, Any] = {"dpi": dpi, "sharex": True, "sharey": True, "squeeze": False}
    figure, axes = new_figure(panel * columns + EDGES, height, rows, columns, **more)
    updates = []
    for ax, (source, plane) in zip(axes.flat, planes.items(), strict=True):
        table, tracks = (tables or {}).get(source), vortices.get(source, [])
        top = None if source == "difference" else limit
        shade, moving, update = _panel(ax, plane, tracks, table, scale, top)
        for outline in fixed:
            ax.fill(*(outline.T * MM), color=GREY)
        ax.set(xlim=(x0 * MM, x1 * MM), ylim=(y0 * MM, y1 * MM), aspect="equal")
        moving.append(ax.text(0, 1.015, "", transform=ax.transAxes, weight="bold", size=11))
        ax.grid(False)
        updates.append((ax, source, plane, moving, update))
    for ax in axes[-1]:
        ax.set_xlabel("x, mm")
    for ax in axes[:, 0]:
        ax.set_ylabel("y, mm")
    bar = figure.colorbar(shade, ax=list(axes.flat), shrink=0.85, pad=0.01, aspect=30)
    strays = list(planes) == ["difference"]
    bar.set_label("speed of the difference, % of peak tip speed" if strays else
                  "vorticity, 1/s (purple: clockwise)")  # fmt: skip
    bar.outline.set_visible(False)
    if not strays:
        bar.set_ticks([sign * part * limit for part in (0, 0.1, 0.3, 1) for sign in (1, -1)])
        bar.ax.yaxis.set_major_formatter(lambda value, _: minus(f"{value:.3g}"))
    figure.canvas.draw()
    figure.set_layout_engine("none")  # laid out once: every frame draws only what moves
    for _, _, _, moving, _ in updates:
        for artist in moving:
            artist.set_animated(True)
    figure.canvas.draw()
    still = figure.canvas.copy_from_bbox(figure.bbox)

    def show(time: float) -> ndarray:
        figure.canvas.restore_region(still)
        for ax, source, plane, moving, update in updates:
            # PIV has fewer instants than the sheet.
            shown = float(plane["time"][_nearest(plane, time)])
            moving[-1].set_text(f"{NAMES.get(source, source)}, {shown:.3f} s")
            update(shown)
            for artist in sorted(moving, key=lambda artist: artist.get_zorder()):
                ax.draw_artist(artist)
        return pixels(figure)

    return show


def format_instant(plane: xr.Dataset, time: float) -> str:
    """An instant (s) with the bend of the first finger then."""
    bends = plane["bend"].values[:, 0] if "bend" in plane else np.zeros(1)
    if np.ptp(bends) <= REST:
        return f"{time:.3f} s"
    bend = np.degrees(np.interp(time, plane["time"].values, bends))
    return f"{time:.3f} s, bent by {minus(f'{bend:.0f}')}°"


def others(table: pd.DataFrame, judged: list[pd.DataFrame], time: float) -> pd.DataFrame:
    """The strong vortices of an instant (s) that are not marked as `judged` then."""
    now = table[np.isclose(table["time"], time, atol=1e-6)]
    known = [v.loc[(v["time"] - time).abs().idxmin(), "track"] for v in judged if _at(v, time).size]
    strong = now["circulation"].abs() >= _RIVAL * now["circulation"].abs().max()
    return now[strong & ~now["track"].isin(known)]


def _panel(
    ax,
    plane: xr.Dataset,
    vortices: list[pd.DataFrame],
    table: pd.DataFrame | None,
    scale: float,
    limit: float | None,
):
    x, y = plane["x"].values, plane["y"].values
    dx, dy = x[1] - x[0], y[1] - y[0]
    every = max(1, round(_ARROW_EVERY / dx))
    rows, columns = np.arange(every // 2, y.size, every), np.arange(every // 2, x.size, every)
    extent = np.array([x[0] - dx / 2, x[-1] + dx / 2, y[0] - dy / 2, y[-1] + dy / 2]) * MM
    blank = np.full((y.size, x.size), np.nan)
    norm = None if limit is None else AsinhNorm(_LINEAR * limit, -limit, limit)
    colours = _STRAYS if norm is None else {"cmap": COLOUR_MAP, "norm": norm}
    shade = ax.imshow(blank, extent=extent, **_SHADE, **colours)
    gx, gy = np.meshgrid(x[columns] * MM, y[rows] * MM)
    hidden = np.ma.masked_all(gx.shape)
    # 45 % of the tip's peak speed reaches to the next vector.
    unit = 0.45 * scale / (every * dx * MM)
    arrows = ax.quiver(gx, gy, hidden, hidden, scale=unit, **_ARROWS)
    known = float(f"{0.5 * scale:.1g}")
    beside = {"labelpos": "W", "coordinates": "axes", "fontproperties": {"size": 9}}
    ax.quiverkey(arrows, 0.93, 1.03, known, f"{known:g} m/s", **beside)
    fingers = range(plane.sizes.get("finger", 0) if "outline" in plane else 0)
    bodies = [ax.fill([], [], color=BODY, zorder=3)[0] for _ in fingers]
    (beside_them,) = ax.plot([], [], **_OTHER)
    marks = [ax.plot([], [], **_MARK)[0] for _ in vortices]

    def update(time: float) -> None:
        index = _nearest(plane, time)
        field, valid = frame(plane, index)
        speed = np.linalg.norm(field, axis=0)
        strays = np.where(valid, 100 * speed / scale, np.nan)
        shade.set_data(strays if limit is None else vorticity(field, valid, x, y))
        quiet = ~valid | (speed < _STILL * scale)
        drawn = np.ma.masked_array(field, mask=np.broadcast_to(quiet, field.shape))
        arrows.set_UVC(*drawn[:, rows[:, None], columns])
        for number, body in enumerate(bodies):
            body.set_xy(plane["outline"].values[index, number] * MM)

        def marked(places: ndarray) -> ndarray:
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
            now = _at(vortex, time)
            mark.set_data(*marked(now))
            part = np.abs(now[:, -1]).sum() / vortex["circulation"].abs().max()
            mark.set_linewidth(_WEIGHT[0] + _WEIGHT[1] * part)

    return shade, [shade, arrows, *bodies, beside_them, *marks], update


def _at(vortex: pd.DataFrame, time: float) -> ndarray:
    """A vortex (1, `_MARKED`) between the two rows around `time`; none outside of them."""
    times = vortex["time"].to_numpy()
    after = int(np.clip(np.searchsorted(times, time), 1, max(times.size - 1, 1)))
    if times.size < 2 or not times[after - 1] - 2e-3 <= time <= times[after] + 2e-3:
        return np.empty((0, len(_MARKED)))
    rows = vortex.iloc[after - 1 : after + 1]
    if rows["track"].nunique() > 1:  # of two vortices: the nearer row
        rows = rows.iloc[[int(np.argmin(np.abs(rows["time"].to_numpy() - time)))] * 2]
    return np.array([[float(np.interp(time, rows["time"], rows[n])) for n in _MARKED]])
