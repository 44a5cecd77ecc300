"""The flow on the plane x = 0 between two fingers: the parting line, the jet, and the pressure."""

from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy import ndarray

from piv.formats.plane_series import VECTORS, usable
from postprocess.evidence.fields import frame

COLUMNS = ("time", "stagnation_y", "jet_speed", "jet_y", "rise_speed", "rise_y")
_REST = 0.02  # of the velocity scale: slower than this is no stream, so no line parts two of them


def beside_middle(x: ndarray) -> tuple[slice, float]:
    """The two columns beside x = 0, and the weight of the second; ValueError without that plane."""
    if x[0] > 0 or x[-1] < 0:
        raise ValueError(
            f"the plane series covers x from {x[0]:.4f} to {x[-1]:.4f} m, without the plane between"
            " the fingers"
        )
    after = max(int(np.searchsorted(x, 0.0)), 1)
    return slice(after - 1, after + 1), float(-x[after - 1] / (x[after] - x[after - 1]))


def on_middle(values: ndarray, share: float) -> ndarray:
    """Values on x = 0, linear between its two neighbours (…, 2); NaN where one is absent."""
    if share > 1 - 1e-6:
        return values[..., 1]
    return values[..., 0] if share < 1e-6 else (1 - share) * values[..., 0] + share * values[..., 1]


def parting_height(v: ndarray, y: ndarray, near: float, least: float) -> float:
    """Height nearest to `near` at which `v` over ascending y turns from down to up, NaN if none.

    Both streams, up to where each turns again, must exceed `least` m/s somewhere.
    """
    up = v > 0
    turns = np.flatnonzero(up[1:] != up[:-1])
    edges = np.concatenate([[-1], turns, [v.size - 1]])
    heights = []
    for number, k in enumerate(turns, start=1):
        below, above = v[edges[number - 1] + 1 : k + 1], v[k + 1 : edges[number + 1] + 1]
        if not up[k] and -below.min() >= least and above.max() >= least:
            heights.append(y[k] - v[k] * (y[k + 1] - y[k]) / (v[k + 1] - v[k]))
    return min(heights, key=lambda h: abs(h - near)) if heights else float("nan")


def centreline(plane: xr.Dataset, scale: float) -> pd.DataFrame:
    """`COLUMNS` at every instant of two fingers (m, m/s), and a pressure (Pa) where there is one.

    The fastest downward flow below the parting line and the fastest upward flow above it are of
    x = 0, positive both; where the flow does not part, the tips take the line's place.
    pressure_gap is the one of largest size between the tips on x = 0. `scale`: velocity scale, m/s.
    """
    columns, share = beside_middle(plane["x"].values)
    names = [name for name in ("v", "p") if name in plane]
    beside = plane[[n for n in (*VECTORS, "p") if n in plane]].isel(x=columns).load()
    middle = {n: on_middle(beside[n].where(usable(beside)).values, share) for n in names}
    y, times = plane["y"].values, plane["time"].values
    tips = plane["tip"].values[..., 1].mean(axis=1)
    rows = []
    for tip, v in zip(tips, middle["v"], strict=True):
        known = np.isfinite(v)
        rows.append(_streams(v[known], y[known], tip, _REST * scale))
    table = pd.DataFrame(rows, columns=list(COLUMNS[1:]))
    table.insert(0, "time", times)
    if "p" not in plane:
        return table
    between = np.abs(y - tips[:, None]) <= 0.5 * float(plane.attrs["tip_width"])
    p = np.where(between & np.isfinite(middle["p"]), middle["p"], 0.0)
    table["pressure_gap"] = p[np.arange(times.size), np.argmax(np.abs(p), axis=1)]
    return table


def _streams(v: ndarray, y: ndarray, tip: float, least: float) -> tuple[float, ...]:
    """COLUMNS but the time, of the vertical velocity `v` over `y` on x = 0."""
    parting = parting_height(v, y, tip, least)
    split = tip if np.isnan(parting) else parting
    out = [parting]
    for part, sign in ((y < split, -1.0), (y >= split, 1.0)):
        if not part.any():
            out += [np.nan, np.nan]
            continue
        k = int(np.argmax(sign * v[part]))
        out += [max(sign * float(v[part][k]), 0.0), float(y[part][k])]
    return tuple(out)


def crossings(outline: ndarray, height: float) -> ndarray:
    """The x (m) at which a closed outline (point, axis) crosses a height (m)."""
    after = np.roll(outline, -1, axis=0)
    cut = (outline[:, 1] <= height) != (after[:, 1] <= height)
    a, b = outline[cut], after[cut]
    return a[:, 0] + (height - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])


def _between_fingers(outline: ndarray, x: ndarray, y: ndarray) -> ndarray:
    """Mask (y, x) of the points nearer to x = 0 than any part of either finger at that height.

    `outline` (finger, point, axis), m, finger 0 on the left. Rows without both are outside.
    """
    inner = np.full((2, y.size), np.nan)
    for finger, sign in ((0, 1.0), (1, -1.0)):
        for row, height in enumerate(y):
            at = crossings(outline[finger], height)
            if at.size:
                inner[finger, row] = sign * np.max(sign * at)
    return (x[None, :] > inner[0][:, None]) & (x[None, :] < inner[1][:, None])


class Oblique(NamedTuple):
    """Share of an area that flows up or down, and the angle from the vertical (rad)."""

    share: float
    angle: float


def oblique_flow(
    plane: xr.Dataset, lines: pd.DataFrame, window: tuple[float, float], above: bool
) -> Oblique:
    """The flow beside the plane x = 0, over the instants of a window (s) at which the flow parts.

    Above the parting line: between the fingers. Below it: within two tip widths of the line and
    one of the plane. ValueError where the flow never parts in the window.
    """
    x, y = plane["x"].values, plane["y"].values
    width = float(plane.attrs["tip_width"])
    sign = 1.0 if above else -1.0
    outlines = plane["outline"].values if above else None
    along, points, across, upright = 0, 0, 0.0, 0.0
    rows = lines[lines["time"].between(*window) & lines["stagnation_y"].notna()]
    for time, height in zip(rows["time"], rows["stagnation_y"], strict=True):
        index = int(np.argmin(np.abs(plane["time"].values - time)))
        field, valid = frame(plane, index)
        if outlines is not None:
            region = (y > height)[:, None] & _between_fingers(outlines[index], x, y)
        else:
            region = ((y < height) & (y > height - 2 * width))[:, None] & (np.abs(x) <= width)
        region &= valid
        vertical = sign * field[1][region]
        along += int((vertical > 0).sum())
        points += vertical.size
        across += np.abs(field[0][region]).sum()
        upright += np.abs(vertical).sum()
    if points == 0:
        raise ValueError(
            "the flow between the fingers does not part into up and down between"
            f" {window[0]:.3f} and {window[1]:.3f} s"
        )
    return Oblique(along / points, float(np.arctan2(across, upright)))
