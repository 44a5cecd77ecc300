"""Tip vortex and jet of a plane series over time, and their uncertainty from the vectors'."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from scipy.ndimage import gaussian_filter

from fileio.formats.plane_series import usable, vectors_of
from piv.vortices.find import VortexSettings, find_vortices
from piv.vortices.table import tabulate_vortices
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.fields import frame
from postprocess.evidence.vortex_integral import CIRCLE, vortex_integral, vortex_integrals
from postprocess.lab.judgement.inputs_of_budget import Case

COLUMNS = ("circulation", "x", "y", "core_radius", "jet_speed")
JET_REACH = 1.5  # tip widths around the tip
JET_PERCENTILE = 90.0  # higher ones hang on single vectors beside the moving body
BOX = 3.5  # core radii around the vortex in which it is fitted again
REPLICAS = 6


def measure(case: Case, plane: xr.Dataset, name: str) -> pd.DataFrame:
    """Tip vortex (centre in the tank frame) and jet of a camera-frame series over time.

    The circulation is integrated over the circle `CIRCLE` around the centre, from vectors that are
    `seen` in all sides: a fitted one follows the core's width, which grid and windows change.
    ValueError where no vortex is near the finger's tip within the window (s).
    """
    table = tabulate_vortices(plane, case.vortices)
    side = table["side"].astype(object).fillna("").astype(str)
    finger = table["finger"].astype("float").fillna(-1).astype(int)
    table = table.assign(side=side, finger=finger)
    track = tracks.dominant_track(table, 0, case.window, name).set_index("time")
    times = plane["time"].values
    out = pd.DataFrame({"time": times})
    out["core_radius"] = track["core_radius"].reindex(times).to_numpy(float)
    width = float(plane.attrs["tip_width"])
    counted = plane.drop_vars("flag", errors="ignore").assign(valid=usable(plane) & case.seen())
    span = times[0], times[-1]
    integral = vortex_integrals(counted, track.reset_index(), CIRCLE * width, span)
    integral = integral.set_index("time")
    out["circulation"] = integral["circulation"].reindex(times).to_numpy(float)
    # where there is no vortex, its track is only interpolated
    out.loc[out["core_radius"].isna(), "circulation"] = np.nan
    centre = track[["x", "y"]].reindex(times).to_numpy(float)
    out["x"], out["y"] = case.registration.pose.from_camera(centre).T
    out["jet_speed"] = [_jet_speed(plane, k) for k in range(times.size)]
    return out


def _jet_speed(plane: xr.Dataset, index: int) -> float:
    """90th percentile of the speed within 1.5 tip widths of a tip, m/s; NaN without a vector."""
    (u, v), valid = frame(plane, index)
    gx, gy = np.meshgrid(plane["x"].values, plane["y"].values)
    near = np.zeros(valid.shape, bool)
    for tip in plane["tip"].values[index]:
        near |= np.hypot(gx - tip[0], gy - tip[1]) < JET_REACH * float(plane.attrs["tip_width"])
    speed = np.hypot(u, v)[near & valid]
    return float(np.percentile(speed, JET_PERCENTILE)) if speed.size else float("nan")


def scatter(
    case: Case, plane: xr.Dataset, table: pd.DataFrame, rows: np.ndarray
) -> dict[str, float]:
    """Standard uncertainty of each quantity at one instant from the vectors' own, by Monte Carlo.

    Errors of vectors within a window are alike and drawn smooth over it. The vortex is fitted again
    around its place; RMS over the instants `rows`.
    """
    if "u_std" not in plane:
        raise ValueError(
            "the vectors carry no uncertainty (u_std, v_std); give vectors.std_px in dpiv.toml"
        )
    rng = np.random.default_rng(1)
    x, width = plane["x"].values, float(plane.attrs["tip_width"])
    seen, smooth, radius = case.seen(), (case.window_m / 4) / (x[1] - x[0]), CIRCLE * width
    moved: dict[str, list[float]] = {name: [] for name in COLUMNS}
    for k in rows:
        row = table.iloc[k]
        at = case.registration.pose.to_camera(np.array([row["x"], row["y"]]))
        reach = max(BOX * row["core_radius"], radius) + 2 * (x[1] - x[0])
        now = vectors_of(plane).isel(time=k, drop=True)
        now = now.assign(seen=usable(now) & seen[k])
        box = now.sel(x=slice(at[0] - reach, at[0] + reach), y=slice(at[1] - reach, at[1] + reach))
        fits = []
        for replica in range(REPLICAS + 1):
            shaken = _shaken(box, smooth, rng) if replica else box
            vortex = _nearest(shaken, case.vortices, at, row["circulation"])
            if vortex is None:
                continue
            velocity = np.stack([shaken["u"].values, shaken["v"].values])
            place, axes = (vortex.x, vortex.y), (shaken["x"].values, shaken["y"].values)
            whole = vortex_integral(
                axes, velocity, shaken["seen"].values, place, vortex.circulation, radius, width
            )
            if whole is not None:
                fits.append([whole[0], vortex.x, vortex.y, vortex.core_radius])
        if len(fits) > 2:
            spread = np.std(fits[1:], axis=0, ddof=1)
            for name, value in zip(COLUMNS[:4], spread, strict=True):
                moved[name].append(float(value))
        moved["jet_speed"].append(_jet_scatter(plane.isel(time=[k]), smooth, rng))
    if not moved["circulation"]:
        raise ValueError(
            "the tip vortex cannot be fitted again with the vectors' uncertainty; is it too large?"
        )
    return {name: float(np.sqrt(np.mean(np.square(values)))) for name, values in moved.items()}


def _jet_scatter(plane: xr.Dataset, smooth: float, rng: np.random.Generator) -> float:
    """Standard deviation of one instant's jet speed under the vectors' uncertainty."""
    reach = 1.2 * JET_REACH * float(plane.attrs["tip_width"])
    tips = plane["tip"].values[0]
    (x0, y0), (x1, y1) = tips.min(axis=0) - reach, tips.max(axis=0) + reach
    box = plane.sel(x=slice(x0, x1), y=slice(y0, y1))
    speeds = [_jet_speed(_shaken(box, smooth, rng), 0) for _ in range(REPLICAS)]
    return float(np.std(speeds, ddof=1))


def _shaken(box: xr.Dataset, smooth: float, rng: np.random.Generator) -> xr.Dataset:
    out = box.copy()
    *lead, rows, columns = box["u"].shape
    impulse = np.zeros((rows, columns))
    impulse[rows // 2, columns // 2] = 1.0
    size = np.sqrt(np.sum(gaussian_filter(impulse, smooth) ** 2))
    for name in ("u", "v"):
        noise = gaussian_filter(rng.standard_normal((rows, columns)), smooth, mode="reflect")
        std = np.nan_to_num(box[f"{name}_std"].values)
        out[name] = box[name] + std * (noise / max(size, 1e-12)).reshape(
            *[1] * len(lead), rows, columns
        )
    return out


def _nearest(box: xr.Dataset, settings: VortexSettings, at: np.ndarray, like: float):
    if min(box.sizes["x"], box.sizes["y"]) < 4:
        return None
    vortices = [v for v in find_vortices(box, settings) if v.circulation * like > 0]
    return min(vortices, key=lambda v: np.hypot(v.x - at[0], v.y - at[1])) if vortices else None
