"""How far vectors are from the exact truth of their recording, and whether their bars hold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr
from numpy import ndarray
from scipy import ndimage

from piv.formats.plane_series import make_plane
from piv.formats.recording import pixel_of
from piv.momentum.pressure import pressure
from piv.synthetic.plane_spline import extend
from piv.vortices.find import find_vortices, scale_of
from piv.vortices.settings import VortexSettings
from piv.vortices.vortex import Vortex

# grid steps of the truth: the layer beside walls that has rows of its own, and the smoothing
# length of vortices where the truth knows no tip
LAYER = 4.0
STRONG = 0.3  # of the truth's strongest circulation: weaker vortices are not compared
_LEAST_INSTANTS = 3  # of a pressure


class Sampler:
    """Fields of one instant of the truth at the places of vectors.

    `water`: the nearest truth point is in the water, or there is none; `known`: all four around
    are; `layer`: of those, beside a wall.
    """

    def __init__(self, truth: xr.Dataset, x: ndarray, y: ndarray) -> None:
        ends = [(truth[n].values, q) for n, q in (("y", y), ("x", x))]
        place = [(q - axis[0]) / (axis[1] - axis[0]) for axis, q in ends]
        self._at = np.meshgrid(*place, indexing="ij")
        self._ok = truth["valid"].values != 0
        ok = self._ok.astype(float)
        self.water = self._interpolated(ok, 0, 1.0) > 0.5
        self.known = self._interpolated(ok, 1, 0.0) > 1 - 1e-6
        self.layer = np.zeros(self.known.shape, bool)
        if not self._ok.all():
            away = ndimage.distance_transform_edt(self._ok)
            self.layer = self.known & (self._interpolated(away, 1, 0.0) < LAYER)

    def _interpolated(self, values: ndarray, order: int, outside: float) -> ndarray:
        return ndimage.map_coordinates(values, self._at, order=order, cval=outside)

    def __call__(self, field: xr.DataArray) -> ndarray:
        """Values (y, x) by a cubic spline; NaN where one of the four points around has none."""
        values = field.values.astype(float)
        whole = extend(values, self._ok & np.isfinite(values))
        out = ndimage.map_coordinates(whole, self._at, order=3, mode="mirror")
        return np.where(self.known, out, np.nan)


def score(
    vectors: xr.Dataset, truth: xr.Dataset, *, scale: float | None = None
) -> dict[str, float]:
    """Measures of a plane series `vectors` against `truth`, both in SI with the same origin.

    The instants are matched in order where there are as many, else by time. The truth is sampled
    at the vectors by cubic splines, where all four truth points around one are in the water. Errors
    are in px where the truth states `scale_mm_per_px` and `interval`, else in m/s. `scale`: the
    smoothing length (m) at which both fields' vortices are found. Pressure and force are compared
    where the truth has them; where the vectors have no `p`, `piv.pressure` makes it. NaN where a
    measure does not exist. ValueError where instants do not match.
    """
    vectors, truth = (d if "time" in d.dims else d.expand_dims("time") for d in (vectors, truth))
    truth = truth.isel(time=_matched(vectors, truth))
    instants = [truth.isel(time=k) for k in range(truth.sizes["time"])]
    x, y = vectors["x"].values, vectors["y"].values
    samplers = [Sampler(now, x, y) for now in instants]
    water, known, layer = (
        np.stack([getattr(s, name) for s in samplers]) for name in ("water", "known", "layer")
    )
    vectors = vectors.assign(valid=vectors["valid"].where(water, 0))  # those in bodies are none
    pairs = list(zip(samplers, instants, strict=True))
    exact = {n: np.stack([s(now[n]) for s, now in pairs]) for n in "uv"}
    there = (vectors["valid"].values != 0) & known
    errors = np.stack([np.where(there, vectors[n].values - exact[n], np.nan) for n in "uv"])
    absent = xr.full_like(vectors["u"], np.nan)
    std = np.stack([vectors.get(f"{n}_std", absent).values for n in "uv"])
    pixel, interval = pixel_of(truth.attrs), truth.attrs.get("interval")
    unit, per = ("px", float(interval) / pixel) if pixel and interval else ("m/s", 1.0)
    rows = {"vectors given, %": 100 * there[known].mean()}
    rows |= {
        f"bias of {n}, {unit}": per * _of(e, np.mean) for n, e in zip("uv", errors, strict=True)
    }
    rows[f"RMS error, {unit}"] = per * _rms(errors)
    rows[f"95 % of the errors are below, {unit}"] = per * _of(
        np.hypot(*errors), lambda e: np.percentile(e, 95)
    )
    rows |= {f"within {count} std, %": _covered(errors, std, count) for count in (1, 2)}
    rows["given beside walls, %"] = 100 * there[layer].mean() if layer.any() else np.nan
    rows[f"RMS error beside walls, {unit}"] = per * _rms(errors[:, layer])
    if scale is None:
        step = LAYER * float(truth["x"][1] - truth["x"][0])
        scale = scale_of(truth, VortexSettings()) if "tip_width" in truth.attrs else step
    wall = truth[["outline"]] if "outline" in truth else truth[[]]
    sides = make_plane(x, y, **exact, time=truth["time"].values, valid=known), vectors
    rows |= _vortices(*(_found(side, wall, scale) for side in sides))
    if "p" in truth and len(instants) >= _LEAST_INSTANTS:
        rows |= _pressure(vectors, truth, np.stack([s(now["p"]) for s, now in pairs]))
    return rows


def _matched(vectors: xr.Dataset, truth: xr.Dataset) -> list[int]:
    """The instant of the truth that belongs to each of the vectors."""
    count, exact = vectors.sizes["time"], truth.sizes["time"]
    if count == exact == 1:
        return [0]
    times, at = vectors["time"].values, truth["time"].values
    if count == exact:
        if not np.allclose(np.diff(times), np.diff(at), rtol=0.01):
            own, its = (1 / float(np.diff(clock).mean()) for clock in (times, at))
            raise ValueError(f"the vectors have {own:.6g} fields per second, the truth {its:.6g}")
        return list(range(count))
    away = np.abs(times[:, None] - at)
    if exact > 1 and away.min(axis=1).max() < 0.25 * np.diff(at).min():
        return [int(k) for k in away.argmin(axis=1)]
    raise ValueError(
        f"{count} instants of vectors against {exact} of the truth, at other times: correlate all"
        " pairs of the recording, or state the times"
    )


def _of(values: ndarray, statistic: Callable[[ndarray], float]) -> float:
    """A statistic of what is finite; NaN where nothing is."""
    values = values[np.isfinite(values)]
    return float(statistic(values)) if values.size else np.nan


def _rms(values: ndarray) -> float:
    return _of(values, lambda known: float(np.sqrt(np.mean(known**2))))


def _covered(error: ndarray, std: ndarray, count: float) -> float:
    """Share (%) of errors within `count` standard uncertainties, of those that state one."""
    return 100 * _of(np.abs(error) / std, lambda ratio: float(np.mean(ratio < count)))


def _found(series: xr.Dataset, wall: xr.Dataset, scale: float) -> list[list[Vortex]]:
    """The vortices of each instant, beside the truth's walls."""
    series = series.drop_vars("outline", errors="ignore")
    planes = [
        series.isel(time=k).assign(wall.isel(time=k, missing_dims="ignore").data_vars)
        for k in range(series.sizes["time"])
    ]
    found = [find_vortices(p, scale=scale) if p["valid"].values.any() else [] for p in planes]
    return [[v for v in now if not v.at_edge] for now in found]


def _vortices(exact: list[list[Vortex]], found: list[list[Vortex]]) -> dict[str, float]:
    """Which of the truth's strong vortices are found, and how far off they are."""
    least = STRONG * max((abs(v.circulation_disc) for now in exact for v in now), default=0.0)
    off, gain, extra = [], [], 0
    for true, seen in zip(exact, found, strict=True):
        for v in (v for v in true if abs(v.circulation_disc) >= least):
            away = {
                np.hypot(w.x - v.x, w.y - v.y): w
                for w in seen
                if w.circulation_disc * v.circulation_disc > 0
            }
            near = min(away, default=np.inf)
            off.append(near if near < v.radius else np.nan)
            gain.append(
                away[near].circulation_disc / v.circulation_disc - 1 if near < v.radius else np.nan
            )
        strong = [w for w in seen if abs(w.circulation_disc) >= least]
        extra += sum(all(np.hypot(w.x - v.x, w.y - v.y) > v.radius for v in true) for w in strong)
    return {
        "vortices found, %": 100 * float(np.isfinite(off).mean()) if off else np.nan,
        "vortices that are none": float(extra),
        "RMS distance of vortex centres, mm": 1e3 * _rms(np.array(off)),
        "RMS error of their circulation, %": 100 * _rms(np.array(gain)),
    }


def _pressure(vectors: xr.Dataset, truth: xr.Dataset, exact: ndarray) -> dict[str, float]:
    """Errors of pressure and force; both pressures are known but for a constant."""
    if "p" not in vectors:
        walls = {n: truth[n].variable for n in ("outline", "outline_velocity") if n in truth}
        vectors = pressure(vectors.drop_vars(list(walls), errors="ignore").assign(walls))
    off = vectors["p"].values - exact
    off, exact = (
        np.stack([now - _of(now, np.mean) for now in np.where(np.isnan(off), np.nan, part)])
        for part in (off, exact)
    )
    rows = {"RMS error of pressure, % of its RMS": 100 * _rms(off) / _rms(exact)}
    if "p_std" in vectors:
        rows["pressure within 1 std, %"] = _covered(off, vectors["p_std"].values, 1)
    if "line_force" in truth and "line_force" in vectors:
        error = vectors["line_force"].values - truth["line_force"].values
        rows["RMS error of force, % of its RMS"] = (
            100 * _rms(error) / _rms(truth["line_force"].values)
        )
    return rows
