"""Tip vortex of a plane series over time, and its uncertainty from that of the vectors."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from scipy.ndimage import gaussian_filter

from fileio.formats.plane_series import usable, vectors_of
from piv.vortices.table import tabulate_vortices
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.vortex_integral import CIRCLE, vortex_integral, vortex_integrals
from postprocess.lab.judgement.case import Case

COLUMNS = ("circulation", "x", "y")
REPLICAS = 6
SHAKEN = 8  # instants at which the vectors are drawn again


def measure(case: Case, plane: xr.Dataset, name: str) -> pd.DataFrame:
    """Circulation and centre (tank frame) of the tip vortex of a camera-frame series over time.

    NaN where there is no vortex. Vectors that are not `seen` on all sides do not count.
    ValueError where no vortex is near the finger's tip.
    """
    table = tabulate_vortices(plane, case.vortices)
    side = table["side"].astype(object).fillna("").astype(str)
    finger = table["finger"].astype("float").fillna(-1).astype(int)
    table = table.assign(side=side, finger=finger)
    times = plane["time"].values
    span = times[0], times[-1]
    track = tracks.dominant_track(table, 0, span, name)
    width = float(plane.attrs["tip_width"])
    counted = plane.drop_vars("flag", errors="ignore").assign(valid=usable(plane) & case.seen())
    found = vortex_integrals(counted, track, CIRCLE * width, span).set_index("time")
    found = found.loc[found.index.isin(track["time"])].reindex(times)
    places = case.registration.pose.from_camera(found[["x", "y"]].to_numpy(float))
    out = pd.DataFrame({"time": times, "circulation": found["circulation"].to_numpy(float)})
    return out.assign(x=places[:, 0], y=places[:, 1])


def scatter(
    case: Case, plane: xr.Dataset, table: pd.DataFrame, rows: np.ndarray
) -> dict[str, float]:
    """Standard uncertainty of each quantity at one instant from the vectors' own, by Monte Carlo.

    RMS over at most `SHAKEN` of the instants `rows`. Errors of vectors within a window are alike
    and are drawn smooth over it. ValueError where the vectors carry no uncertainty.
    """
    if "u_std" not in plane:
        raise ValueError(
            "the vectors carry no uncertainty (u_std, v_std); give vectors.std_px in dpiv.toml"
        )
    rng = np.random.default_rng(1)
    x, width = plane["x"].values, float(plane.attrs["tip_width"])
    spacing, radius = float(x[1] - x[0]), CIRCLE * width
    smooth, seen = case.window_m / 4 / spacing, case.seen()
    squares = []
    for k in rows[:: max(1, rows.size // SHAKEN)]:
        row = table.iloc[k]
        at = case.registration.pose.to_camera(np.array([row["x"], row["y"]]))
        reach = radius + 3 * spacing
        now = vectors_of(plane).isel(time=k, drop=True)
        now = now.assign(seen=usable(now) & seen[k])
        box = now.sel(x=slice(at[0] - reach, at[0] + reach), y=slice(at[1] - reach, at[1] + reach))
        axes = box["x"].values, box["y"].values
        drawn = (
            vortex_integral(
                axes,
                _shaken(box, smooth, rng),
                box["seen"].values,
                (float(at[0]), float(at[1])),
                row["circulation"],
                radius,
                width,
            )
            for _ in range(REPLICAS)
        )
        found = [one for one in drawn if one is not None]
        if len(found) > 1:
            squares.append(np.var(found, axis=0, ddof=1))
    if not squares:
        raise ValueError(
            "the tip vortex is lost within the vectors' uncertainty; check vectors.std_px"
        )
    return dict(zip(COLUMNS, np.sqrt(np.mean(squares, axis=0)).tolist(), strict=True))


def _shaken(box: xr.Dataset, smooth: float, rng: np.random.Generator) -> np.ndarray:
    """The vectors (2, y, x) with errors of their own uncertainty, smooth over a window."""
    shape = box["u"].shape
    impulse = np.zeros(shape)
    impulse[shape[0] // 2, shape[1] // 2] = 1.0
    size = max(float(np.sqrt(np.sum(gaussian_filter(impulse, smooth) ** 2))), 1e-12)
    out = []
    for name in ("u", "v"):
        noise = gaussian_filter(rng.standard_normal(shape), smooth, mode="reflect") / size
        out.append(box[name].values + np.nan_to_num(box[f"{name}_std"].values) * noise)
    return np.stack(out)
