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
from postprocess.evidence.dorsal_circulation import dorsal_circulation
from postprocess.evidence.load import FILES
from postprocess.evidence.stage_files import StageFiles
from postprocess.evidence.strokes import peak_tip_speed

_INSTANTS = 12  # of the middle of the stroke at which velocity fields are compared
_NEAR_TIP = 2.0  # tip widths from the tip within which a user looks at the flow
_OF_FLOW = ("error_dorsal", "error_centre", "error_velocity", "error_force")
_OF_PIV = ("error_circulation", "error_centre", "error_velocity")
# Orders that an extrapolation takes: schemes are of second order, walls and time of first.
_ORDERS = (1.0, 2.0)


def errors_against(
    best: StageFiles, files: StageFiles, source: str, window: tuple[float, float]
) -> dict[str, float]:
    """Errors of a run's flow ("cfd") or PIV ("piv") against the flow of `best` over a window (s).

    Each is a part of its own scale, and `error` is the largest. The force's error is from the
    beginning. `error_dorsal` is of all water on the tip's dorsal side.
    """
    with (
        read_plane(best.required(FILES["cfd"], "sheet")) as wanted,
        read_plane(files.required(FILES[source], "piv" if source == "piv" else "sheet")) as got,
    ):
        window = window[0], min(window[1], float(wanted["time"][-1]), float(got["time"][-1]))
        scale, _ = peak_tip_speed(wanted["time"].values, wanted["tip"].values)
        width = float(wanted.attrs["tip_width"])
        sums = fields.field_sums(wanted, _thinned(got, window))
        errors = {"error_velocity": fields.rms_difference(sums) / scale}
        if source == "piv":
            errors |= {"vectors": got.sizes["x"] * got.sizes["y"], "fields": got.sizes["time"]}
        else:
            errors["tip_width_mm"] = width * 1e3
            errors["error_near_tip"] = near_tip_error(wanted, _thinned(got, window))
        tables = {
            name: tracks.read_vortices(of.required(f"vortices_{seen}.csv", "vortices"))
            for name, of, seen in (("best", best, "cfd"), ("other", files, source))
        }
        tips = list(tracks.dominant_tracks(tables, 0, window).values())
        if len(tips) == 2:
            of_vortex = vortex_errors(tips[0], tips[1], window, width)
            errors |= of_vortex
            if source == "cfd" and of_vortex:
                sides = (dorsal_circulation(plane, window) for plane in (wanted, got))
                errors["error_dorsal"] = dorsal_error(*sides)
    if source == "cfd":
        forces = (FORCES.read(of.required("run/forces.csv", "solve")) for of in (best, files))
        errors["error_force"] = force_error(*forces)
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


def dorsal_error(reference: pd.DataFrame, other: pd.DataFrame) -> float:
    """RMS difference of two dorsal circulations over the RMS of the part that the water decides."""
    wanted, of_water = (
        np.interp(other["time"], reference["time"], reference[name])
        for name in ("circulation", "of_water")
    )
    return float(np.sqrt(((other["circulation"] - wanted) ** 2).mean() / (of_water**2).mean()))


def force_error(reference: pd.DataFrame, other: pd.DataFrame) -> float:
    """RMS difference of the force until the reference ends, over the RMS of the reference's."""
    rows = other[other["time"] <= reference["time"].iloc[-1] + 1e-9]
    difference = reference2 = 0.0
    for name in ("fx", "fy"):
        wanted = np.interp(rows["time"], reference["time"], reference[name])
        difference += float(((rows[name] - wanted) ** 2).mean())
        reference2 += float((wanted**2).mean())
    return float(np.sqrt(difference / reference2))


def worst(errors: dict[str, float]) -> dict[str, float]:
    """`error`: the largest of the errors that count; absent where the vortex was not found."""
    counted = _OF_FLOW if "error_dorsal" in errors else _OF_PIV
    if counted[0] not in errors:
        return {}
    return {"error": max(errors[name] for name in counted if name in errors)}


def own_errors(table: pd.DataFrame, runs: list[dict[str, Any]], best: str) -> dict[str, float]:
    """Errors of the best run itself, extrapolated from the next two levels with its overrides.

    The order in the cell's size is that at which their errors fall, within _ORDERS; of one level
    it is the second. Empty where the study has none. `table`: by run; `runs`: of the plan.
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
    for name in table.columns.intersection([*_OF_FLOW, "error_circulation", "error_centre_mm"]):
        error = next_two[name].to_numpy(float)
        order = _falling_order(size, error) if len(size) == 2 else _ORDERS[1]
        own[name] = float(error[0]) / (size[0] ** order - 1)
    return own | worst(own)


def _falling_order(size: np.ndarray, error: np.ndarray) -> float:
    """Order in _ORDERS at which an `error` (2,) falls with cells of `size` (2,) of the best's."""

    def excess(order: float) -> float:
        return float((size[1] ** order - 1) * error[0] - (size[0] ** order - 1) * error[1])

    if excess(_ORDERS[0]) >= 0:
        return _ORDERS[0]
    return _ORDERS[1] if excess(_ORDERS[1]) <= 0 else float(brentq(excess, *_ORDERS))
