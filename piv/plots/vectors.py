"""Vectors over vorticity, with bodies and vortex centres: one figure for all pictures."""

import logging
from dataclasses import dataclass

try:
    import matplotlib
except ImportError:
    raise ValueError("pictures need the package matplotlib: pip install matplotlib") from None

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from piv.formats.plane_series import absent, fields_of, usable

logging.getLogger("matplotlib.font_manager").setLevel(
    logging.ERROR
)  # warns of fonts that nothing here uses

# Blue-white-orange, told apart by every kind of colour vision (ColorBrewer's PuOr, reversed so that
# blue is negative).
COLOUR_MAP = "PuOr_r"
_WIDTH_IN = 6.7
_NEVER_NEGATIVE = (
    "u_rms",
    "v_rms",
    "uu",
    "vv",
    "uu_noise",
    "vv_noise",
    "strain",
    "correlation",
    "n",
)
_ARROWS_ACROSS = 42  # more cannot be read on a printed column


@dataclass(frozen=True)
class Style:
    """Contents of a picture; `mm`: lengths in mm for a plane in m; limits None: from the data."""

    mm: bool = True
    vorticity_limit: float | None = None
    arrow_every: int | None = None
    colour_by: str = "vorticity"  # or a variable of the plane
    streamlines: bool = False  # in place of arrows


def vorticity(field: np.ndarray, ok: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """dv/dx - du/dy of (u, v) over (..., y, x): central differences, NaN next to absent vectors."""
    u, v = np.where(ok, field, np.nan)
    return np.gradient(v, x, axis=-1) - np.gradient(u, y, axis=-2)


def speed_scale(planes: xr.Dataset) -> float:
    """99th percentile of speed: the length of the key arrow and of arrows in animations."""
    ok = usable(planes).values
    speed = np.hypot(planes["u"].values, planes["v"].values)[ok]
    if speed.size == 0:
        raise ValueError(
            "the plane has no usable vector to plot; choose another instant, or correlate with "
            "larger windows"
        )
    return max(float(np.percentile(speed, 99)), 1e-12)


def round_below(value: float) -> float:
    """The largest of 1, 2, 5, 10 … that does not exceed a positive value."""
    ten = 10.0 ** np.floor(np.log10(value) + 1e-9)
    return float(f"{ten * max(k for k in (1, 2, 5) if k * ten <= value * (1 + 1e-9)):.1g}")


def vorticity_scale(planes: xr.Dataset, name: str = "vorticity") -> float:
    """Largest |vorticity|, or value of another variable: the peak of a small core has a colour."""
    omega = np.abs(shaded(planes, name))
    return max(float(np.max(omega, where=np.isfinite(omega), initial=0.0)), 1e-12)


def shaded(plane: xr.Dataset, name: str) -> np.ndarray:
    """Field that colours a picture: a variable of the plane, or its vorticity; else ValueError."""
    if name == "vorticity" and name not in plane:
        field = np.stack([plane["u"].values, plane["v"].values])
        return vorticity(field, usable(plane).values, plane["x"].values, plane["y"].values)
    if name not in (known := fields_of(plane)):
        raise ValueError(
            f"the file has no {name!r} to colour by; it has vorticity, {', '.join(known)}"
        )
    return plane[name].values.astype(float)


def unit_of(plane: xr.Dataset, name: str) -> str:
    """Unit of what `shaded` gives, as the file says it."""
    if name not in plane:
        return "1/s" if plane["x"].attrs.get("units", "m") == "m" else "1/frame"
    return str(plane[name].attrs.get("units", ""))


def draw(
    plane: xr.Dataset,
    vortices: pd.DataFrame | None = None,
    *,
    style: Style,
    speed: float | None = None,
) -> Figure:
    """A figure of one instant; close it with `plt.close`. `vortices`: rows at this instant."""
    length = str(plane["x"].attrs.get("units", "m"))
    velocity = str(plane["u"].attrs.get("units", "m/s"))
    factor, shown = (1e3, "mm") if style.mm and length == "m" else (1.0, length)
    x, y = plane["x"].values * factor, plane["y"].values * factor
    omega = shaded(plane, style.colour_by)
    limit = style.vorticity_limit or vorticity_scale(plane, style.colour_by)
    name = r"vorticity $\omega_z$" if style.colour_by == "vorticity" else style.colour_by
    label = f"{name} ({unit_of(plane, style.colour_by)})"
    speed = speed or speed_scale(plane)
    key = round_below(speed)
    aspect = float(np.ptp(y) / np.ptp(x))
    with plt.rc_context({"font.size": 9, "font.family": "DejaVu Sans", "axes.linewidth": 0.8}):
        size = (_WIDTH_IN, min(max(_WIDTH_IN * 0.82 * aspect + 0.9, 2.4), 9.0))
        figure, axes = plt.subplots(figsize=size, dpi=200, layout="constrained")
        half_x, half_y = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
        extent = (x[0] - half_x, x[-1] + half_x, y[0] - half_y, y[-1] + half_y)
        axes.set_facecolor("0.82")  # absent vectors are grey, not the white of zero vorticity
        never_negative = style.colour_by in _NEVER_NEGATIVE or style.colour_by.endswith("_std")
        colours = "viridis" if never_negative else COLOUR_MAP
        picture = axes.imshow(
            omega, colours, origin="lower", extent=extent, interpolation="nearest"
        )
        picture.set_clim(0 if never_negative else -limit, limit)
        step = style.arrow_every or max(1, round(max(x.size, y.size) / _ARROWS_ACROSS))
        cut = (slice(step // 2, None, step), slice(step // 2, None, step))
        known = usable(plane).values
        ok = known[cut]
        xx, yy = np.meshgrid(x[cut[1]], y[cut[0]])
        u, v = plane["u"].values[cut][ok], plane["v"].values[cut][ok]
        if style.streamlines:
            along, up = (np.where(known, plane[n].values, np.nan) for n in ("u", "v"))
            axes.streamplot(x, y, along, up, color="0.1", linewidth=0.6, arrowsize=0.7, density=1.6)
        else:
            scale = {
                "angles": "xy",
                "scale_units": "xy",
                "scale": speed / (1.6 * step * (x[1] - x[0])),
            }
            arrows = axes.quiver(
                xx[ok], yy[ok], u, v, **scale, width=0.0016, color="0.1", pivot="mid"
            )
            axes.quiverkey(
                arrows,
                0.86,
                1.03,
                key,
                f"{key:g} {velocity}",
                labelpos="E",
                coordinates="axes",
            )
        if "outline" in plane:
            outline = plane["outline"].values * factor
            for body in outline.reshape(-1, *outline.shape[-2:]):
                axes.fill(
                    body[:, 0], body[:, 1], facecolor="0.15", edgecolor="k", linewidth=0.8, zorder=3
                )
        if vortices is not None:
            _mark(axes, vortices, factor)
        axes.set(xlim=extent[:2], ylim=extent[2:], aspect="equal")
        axes.set(xlabel=f"$x$ ({shown})", ylabel=f"$y$ ({shown})")
        title = ""
        if "time" in plane.coords and plane["time"].ndim == 0:
            title = f"$t$ = {float(plane['time']):.6g} {plane['time'].attrs.get('units', 's')}"
            title += ", no field" if absent(plane) else ""
        axes.set_title(title, loc="left", fontsize=9)
        bar = figure.colorbar(
            picture, ax=axes, shrink=0.85, pad=0.02, extend="max" if never_negative else "both"
        )
        bar.set_label(label)
    return figure


def _mark(axes: plt.Axes, vortices: pd.DataFrame, factor: float) -> None:
    for row in vortices.itertuples():
        centre = row.x * factor, row.y * factor
        turn = getattr(row, "peak_vorticity", row.circulation)  # known at the plane's edge, too
        marker, line = ("o", "-") if turn > 0 else ("s", "--")
        axes.plot(*centre, marker, mfc="none", mec="k", mew=1.2, ms=6, zorder=4)
        circle = {"radius": row.radius * factor, "color": "k", "lw": 1.0, "ls": line}
        axes.add_patch(plt.Circle(centre, **circle, fill=False, zorder=4))


def vortices_at(table: pd.DataFrame | None, time: float | None) -> pd.DataFrame | None:
    """Rows of one instant (to 1 µs); all rows where the plane has no time."""
    if table is None or time is None:
        return table
    return table[np.abs(table["time"] - time) < 1e-6]
