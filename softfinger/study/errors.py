"""Errors of a run against the best run of a study, whose own error is extrapolated."""

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.optimize import brentq

from pipeline.formats.records import FORCES
from piv.formats.plane_series import read_plane
from postprocess.evidence import fields
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.load import FILES
from postprocess.evidence.stage_files import StageFiles
from postprocess.evidence.strokes import peak_tip_speed

_INSTANTS = 12  # of the middle of the stroke at which velocity fields are compared
_NEAR_TIP = 2.0  # tip widths from the tip within which a user looks at the flow
_OF_VORTEX = ("error_circulation", "error_centre")
_COUNTED = (*_OF_VORTEX, "error_near_tip", "error_velocity", "error_force")
_GAP = 0.6  # of the time between two planes, from a known instant to one that is compared
_LATE = 3  # windows between the middle of the stroke and the end of the run
# Orders that an extrapolation takes: schemes are of second order, walls and time of first.
_ORDERS = (1.0, 2.0)
_ROUNDING = 1e-9


def stroke_windows(middle: tuple[float, float], end: float) -> list[tuple[float, float]]:
    """Windows (s) of a run that ends at `end`: the middle of its stroke, and parts of the rest."""
    edges = np.linspace(middle[1], end, _LATE + 1)
    return [middle, *zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)]


def errors_against(
    best: StageFiles, files: StageFiles, source: str, window: tuple[float, float]
) -> dict[str, float]:
    """Errors of a run's flow ("cfd") or PIV ("piv") against the flow of `best` over a window (s).

    Each is a part of its own scale in the window, and `error` is the largest of _COUNTED.
    """
    with (
        read_plane(best.required(FILES["cfd"], "sheet")) as wanted,
        read_plane(files.required(FILES[source], "piv" if source == "piv" else "sheet")) as got,
    ):
        scale, _ = peak_tip_speed(wanted["time"].values, wanted["tip"].values)
        width = float(wanted.attrs["tip_width"])
        shown = _thinned(got, window)
        sums = fields.field_sums(wanted, shown)
        errors = {"error_velocity": fields.rms_difference(sums) / scale}
        if source == "cfd":
            errors["error_near_tip"] = near_tip_error(wanted, shown)
    reference, other = (
        tracks.read_vortices(of.required(f"vortices_{seen}.csv", "vortices"))
        for of, seen in ((best, "cfd"), (files, source))
    )
    tip = tip_vortex(reference, window)
    same = same_vortex(other, tip, window)
    instants = other.loc[other["time"].between(*window), "time"].nunique()
    if len(same) >= max(1.0, tracks.ENOUGH * instants):
        errors |= vortex_errors(tip, same, window, width)
    if source == "cfd":
        wanted_force, force = (
            FORCES.read(of.required("run/forces.csv", "solve")) for of in (best, files)
        )
        errors["error_force"] = force_error(wanted_force, force, window)
    return errors | worst(errors)


def _thinned(plane: xr.Dataset, window: tuple[float, float]) -> xr.Dataset:
    """About _INSTANTS instants of a window (s)."""
    times = plane["time"].values
    inside = np.flatnonzero((times >= window[0]) & (times <= window[1]))
    return plane.isel(time=inside[:: max(1, len(inside) // _INSTANTS)])


def near_tip_error(reference: xr.Dataset, other: xr.Dataset) -> float:
    """RMS of the vector difference within _NEAR_TIP of the tip over the reference's there."""
    reach = _NEAR_TIP * float(reference.attrs["tip_width"])
    sums = fields.field_sums(reference, other, reach)
    return float(np.sqrt(sums["difference2"].sum() / sums["reference2"].sum()))


def tip_vortex(table: pd.DataFrame, window: tuple[float, float]) -> pd.DataFrame:
    """The strongest vortex near the tip, of the window's sense, at each instant where it is found.

    Not by its track, which may go on in another vortex where the finder has lost one.
    """
    ranking = tracks.strengths(table, 0, window)
    if ranking.empty:
        return table[:0]
    sense = np.sign(table.loc[table["track"] == ranking.index[0], "circulation"].median())
    found = _found(table, window, sense)
    found = found[found["tip_distance"] <= tracks.REACH]
    strongest = found.loc[found.groupby("time")["circulation"].idxmax()]
    enough = tracks.RIVAL * strongest["circulation"].median()
    signed = strongest[strongest["circulation"] >= enough]
    return signed.assign(circulation=sense * signed["circulation"]).reset_index(drop=True)


def same_vortex(
    table: pd.DataFrame, tip: pd.DataFrame, window: tuple[float, float]
) -> pd.DataFrame:
    """The vortex of `table` that is nearest to `tip` at each instant, of its sense and strength."""
    if tip.empty:
        return table[:0]
    sense = np.sign(tip["circulation"].iloc[0])
    found, time = _found(table, window, sense), tip["time"]
    x, y, strength = (np.interp(found["time"], time, tip[n]) for n in ("x", "y", "circulation"))
    # none where the vortex is not known of the reference at about that time
    spacing = _GAP * float(np.diff(time).min()) if len(time) > 1 else 0.0
    apart = np.abs(np.subtract.outer(found["time"].to_numpy(), time.to_numpy())).min(axis=1)
    rival = (found["circulation"] >= tracks.RIVAL * np.abs(strength)) & (apart <= spacing + 1e-9)
    distance = np.hypot(found["x"] - x, found["y"] - y)[rival]
    nearest = found.loc[distance.groupby(found["time"]).idxmin()]
    return nearest.assign(circulation=sense * nearest["circulation"]).reset_index(drop=True)


def _found(table: pd.DataFrame, window: tuple[float, float], sense: float) -> pd.DataFrame:
    """Vortices of a sense within a window that were found, with the size of their circulation."""
    signed = table.assign(circulation=sense * table["circulation"])
    kept = (table["bridged"] == 0) & (table["finger"] == 0) & table["time"].between(*window)
    return signed[kept & (signed["circulation"] > 0)]


def vortex_errors(
    reference: pd.DataFrame, other: pd.DataFrame, window: tuple[float, float], width: float
) -> dict[str, float]:
    """RMS of circulation, peak vorticity (parts of the reference's) and centre (tip widths).

    Empty where the two have no instant in common.
    """
    if reference.empty or other.empty:
        return {}
    pair = tracks.pair_tracks(reference, other)
    pair = pair[pair["time"].between(*window)]
    if pair.empty:
        return {}
    distance = tracks.centre_distance(pair)
    return {
        "error_circulation": tracks.relative_difference(pair, "circulation"),
        "error_peak_vorticity": tracks.relative_difference(pair, "peak_vorticity"),
        "error_centre": distance / width,
        "error_centre_mm": distance * 1e3,
    }


def force_error(reference: pd.DataFrame, other: pd.DataFrame, window: tuple[float, float]) -> float:
    """RMS difference of the force over a window (s), over the RMS of the reference's there."""
    rows = other[other["time"].between(*window)]
    difference = reference2 = 0.0
    for name in ("fx", "fy"):
        wanted = np.interp(rows["time"], reference["time"], reference[name])
        difference += float(((rows[name] - wanted) ** 2).mean())
        reference2 += float((wanted**2).mean())
    return float(np.sqrt(difference / reference2))


def worst(errors: dict[str, float]) -> dict[str, float]:
    """`error`: the largest of the errors that count; absent where the vortex was not found."""
    if not errors.keys() >= set(_OF_VORTEX):
        return {}
    return {"error": max(errors[name] for name in _COUNTED if name in errors)}


def own_errors(table: pd.DataFrame, runs: list[dict[str, Any]], best: str) -> dict[str, float]:
    """Errors of the best run itself, extrapolated from the next two levels with its overrides.

    The order in the cell's size is that at which their errors fall, at most the second; of one
    level it is the second. Where they fall slower than at the first the grids do not converge, and
    the error is taken as large as the next level's. Empty where the study has no level. `table`: by
    run; `runs`: of the plan.
    """
    of_best = next(r["overrides"] for r in runs if r["run"] == best)
    alike = [r["run"] for r in runs if r["until"] != "vortices" and r["overrides"] == of_best]
    known = [r for r in alike if r != best and np.isfinite(table["error"].get(r, np.nan))]
    next_two = table.loc[sorted(known, key=lambda r: -table.loc[r, "cells"])[:2]]
    dimensions = 2 if table.loc[best, "model"] == "2d" else 3
    size = (table.loc[best, "cells"] / next_two["cells"].to_numpy(float)) ** (1 / dimensions)
    if not known or size[0] <= 1:
        return {}
    own = {}
    for name in table.columns.intersection([*_COUNTED, "error_centre_mm"]):
        error = next_two[name].to_numpy(float)
        order = _falling_order(size, error) if len(size) == 2 else _ORDERS[1]
        own[name] = float(error[0]) / (size[0] ** order - 1 if order else 1.0)
    return own | worst(own)


def _falling_order(size: np.ndarray, error: np.ndarray) -> float | None:
    """Order in _ORDERS at which an `error` (2,) falls with cells of `size` (2,) of the best's.

    None where it falls slower.
    """

    def excess(order: float) -> float:
        return float((size[1] ** order - 1) * error[0] - (size[0] ** order - 1) * error[1])

    if (slower := excess(_ORDERS[0])) >= 0:
        return None if slower > _ROUNDING else _ORDERS[0]
    return _ORDERS[1] if excess(_ORDERS[1]) <= 0 else float(brentq(excess, *_ORDERS))
