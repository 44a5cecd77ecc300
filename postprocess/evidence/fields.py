"""Velocity fields against each other: two plane series on the common region, frame by frame."""

import numpy as np
import pandas as pd
import xarray as xr
from numpy import ndarray
from scipy.ndimage import map_coordinates

from piv.formats.plane_series import Planes, check_vectors, usable, vectors_of

ROUNDING = 1e-9  # a weight or time below this is rounding, not information


@xr.register_dataset_accessor("vectors")
class _Vectors(Planes):
    """The vectors alone of a plane series, by the instant's number."""

    def __init__(self, series: xr.Dataset) -> None:
        super().__init__(vectors_of(series))


def _onto_grid(
    field: ndarray,
    valid: ndarray,
    x: ndarray,
    y: ndarray,
    new_x: ndarray,
    new_y: ndarray,
) -> tuple[ndarray, ndarray]:
    """Bilinear values (component, y, x) on new axes, and where no invalid neighbour has weight.

    `field` is (component, y, x) on the regular axes x, y.
    """
    rows = (new_y - y[0]) / (y[1] - y[0])
    columns = (new_x - x[0]) / (x[1] - x[0])
    inside = (rows >= -ROUNDING)[:, None] & (rows <= y.size - 1 + ROUNDING)[:, None]
    inside = inside & (columns >= -ROUNDING) & (columns <= x.size - 1 + ROUNDING)
    at = np.meshgrid(np.clip(rows, 0, y.size - 1), np.clip(columns, 0, x.size - 1), indexing="ij")
    parts = [valid.astype(float), *np.where(valid, field, 0.0)]
    weight, *values = (map_coordinates(part, at, order=1, mode="constant") for part in parts)
    return np.stack(values), inside & (weight > 1 - ROUNDING)


def frame(plane: xr.Dataset, index: int) -> tuple[ndarray, ndarray]:
    """Velocity (2, y, x) of one instant, and which vectors are usable (y, x).

    ValueError where a valid vector is no number.
    """
    now = plane.vectors[index]
    try:
        check_vectors(now)
    except ValueError as error:
        file = plane.encoding.get("source", "a series")
        raise ValueError(f"{file}: frame {index}: {error}; make the file again") from None
    return np.stack([now["u"].values, now["v"].values]), usable(now).values


def _at_time(plane: xr.Dataset, time: float) -> tuple[ndarray, ndarray]:
    """Velocity linear in time between the two frames around `time`; valid where both are."""
    times = plane["time"].values
    after = int(np.clip(np.searchsorted(times, time - ROUNDING), 0, times.size - 1))
    if abs(times[after] - time) <= ROUNDING:
        return frame(plane, after)
    share = (time - times[after - 1]) / (times[after] - times[after - 1])
    (early, early_ok), (late, late_ok) = frame(plane, after - 1), frame(plane, after)
    return (1 - share) * early + share * late, early_ok & late_ok


def _near(points: ndarray, x: ndarray, y: ndarray, reach: float) -> ndarray:
    """Which points (y, x) of a grid lie within `reach` (m) of one of `points` (n, 2)."""
    apart = np.hypot(x - points[:, 0, None, None], y[:, None] - points[:, 1, None, None])
    return np.asarray((apart <= reach).any(axis=0))


def _common_times(reference: xr.Dataset, other: xr.Dataset) -> ndarray:
    """Indices of `other`'s instants within `reference`'s; ValueError where there is none."""
    span, times = reference["time"].values, other["time"].values
    index = np.flatnonzero((times >= span[0] - ROUNDING) & (times <= span[-1] + ROUNDING))
    if index.size == 0:
        raise ValueError(
            f"the two series share no instant: {span[0]:.4f}…{span[-1]:.4f} s against"
            f" {times[0]:.4f}…{times[-1]:.4f} s"
        )
    return index


def field_sums(reference: xr.Dataset, other: xr.Dataset, reach: float = np.inf) -> pd.DataFrame:
    """Sums over the common valid points at every instant and on the grid of `other`.

    `reach` (m): within it of a tip of `reference` alone.

    Columns: time, points, difference2, reference2, other2, product (sums of |b − a|², |a|², |b|²,
    a·b in m²/s²). One frame is in memory at a time.
    """
    x, y = reference["x"].values, reference["y"].values
    new_x, new_y = other["x"].values, other["y"].values
    rows = []
    for index in _common_times(reference, other):
        time = float(other["time"].values[index])
        a, a_ok = _onto_grid(*_at_time(reference, time), x, y, new_x, new_y)
        if np.isfinite(reach):
            tips = reference["tip"].sel(time=time, method="nearest").values
            a_ok &= _near(tips, new_x, new_y, reach)
        b, b_ok = frame(other, int(index))
        both = a_ok & b_ok
        a, b = a[:, both], b[:, both]
        sums = [((b - a) ** 2).sum(), (a**2).sum(), (b**2).sum(), (a * b).sum()]
        rows.append([time, int(both.sum()), *sums])
    sums_named = ["difference2", "reference2", "other2", "product"]
    return pd.DataFrame(rows, columns=["time", "points", *sums_named])


def rms_difference(sums: pd.DataFrame) -> float:
    """RMS of the vector difference over all points, m/s; ValueError without a common point."""
    points = sums["points"].sum()
    if points == 0:
        raise ValueError("the two velocity fields have no valid point in common")
    return float(np.sqrt(sums["difference2"].sum() / points))


def correlation(sums: pd.DataFrame) -> float:
    """Σ a·b / √(Σ|a|² Σ|b|²), −1 to 1; ValueError where one field is at rest."""
    norm = np.sqrt(sums["reference2"].sum() * sums["other2"].sum())
    if norm == 0:
        raise ValueError(
            "one of the two velocity fields is at rest, so their correlation is not defined"
        )
    return float(sums["product"].sum() / norm)


def field_series(sums: pd.DataFrame, rest_speed: float) -> pd.DataFrame:
    """RMS difference (m/s) and correlation per instant; no correlation below an RMS speed (m/s)."""
    points = sums["points"].clip(lower=1)
    norm = np.sqrt(sums["reference2"] * sums["other2"])
    moving = np.sqrt(sums["reference2"] / points) > rest_speed
    difference = np.sqrt(sums["difference2"] / points)
    return pd.DataFrame(
        {
            "time": sums["time"],
            "velocity_rms_difference": difference.where(sums["points"] > 0),
            "velocity_correlation": sums["product"] / norm.where(moving),
        }
    )


def difference(reference: xr.Dataset, other: xr.Dataset, times: ndarray) -> xr.Dataset:
    """`other` less `reference` (m/s) at the instants of `other` nearest to some times (s)."""
    near = np.unique([int(np.argmin(np.abs(other["time"].values - time))) for time in times])
    index = np.intersect1d(near, _common_times(reference, other))
    grids = [reference[n].values for n in "xy"] + [other[n].values for n in "xy"]
    out = other.isel(time=index).load()
    for k, time in enumerate(out["time"].values):
        expected, known = _onto_grid(*_at_time(reference, float(time)), *grids)
        measured, ok = frame(out, k)
        for name, values in zip(("u", "v"), measured - expected, strict=True):
            out[name][k] = np.where(known & ok, values, np.nan)
        out["valid"][k] = known & ok
    return out
