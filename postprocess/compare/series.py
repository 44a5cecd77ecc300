"""The comparison as series over time and as key numbers over the middle of the stroke."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from postprocess.compare.quantities import paired
from postprocess.evidence import fields
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.evidence import Evidence, Part

Window = tuple[float, float]
REST = 0.01  # of the scale; slower than this on average is rest, where a correlation says nothing


def series_table(evidence: Evidence, window: Window) -> pd.DataFrame:
    """Time series at the PIV's instants (the CFD's without PIV); empty cells where a vortex does not exist."""
    master = "piv" if evidence.has("piv") else "cfd"
    times = evidence.planes[master]["time"].values
    cfd = evidence.planes["cfd"]
    bend = np.degrees(np.interp(times, cfd["time"].values, cfd["bend"].values[:, 0]))
    table = pd.DataFrame({"time": times, "bend_deg": bend})
    for source, track in tracks.dominant_tracks(evidence.vortices, 0, window).items():
        there = (times >= track["time"].iloc[0] - 1e-9) & (times <= track["time"].iloc[-1] + 1e-9)
        for name in (n for n in (*tracks.COMPARED, "circulation_std") if n in track):
            values = np.interp(times, track["time"], track[name].astype(float))
            table[f"{name}_{source}"] = pd.Series(values).where(there)
    if "piv-cfd" in evidence.sums:
        velocity = fields.field_series(evidence.sums["piv-cfd"], REST * evidence.scale)
        table = table.merge(velocity, on="time", how="left")
    if {"x_cfd", "x_piv"} <= set(table.columns):
        table["centre_distance"] = np.hypot(
            table["x_piv"] - table["x_cfd"], table["y_piv"] - table["y_cfd"]
        )
    return table


def summary(evidence: Evidence, window: Window) -> dict[str, Any]:
    """Key numbers over a window, of each source and of PIV against CFD; None where a number cannot be measured."""
    tips = tracks.dominant_tracks(evidence.vortices, 0, window)
    out: dict[str, Any] = {source: _vortex_numbers(track, window) for source, track in tips.items()}
    if "piv-cfd" in evidence.sums:
        out["piv-cfd"] = _velocity_numbers(evidence, window) | _pair_numbers(evidence, window)
    return out


def _vortex_numbers(track: pd.DataFrame, window: Window) -> dict[str, Any]:
    rows = track[track["time"].between(*window)]
    return {
        "circulation_mean": float(rows["circulation"].mean()),
        "circulation_peak": float(track.loc[track["circulation"].abs().idxmax(), "circulation"]),
        "core_radius_mean": float(rows["core_radius"].mean()),
        "side": str(rows["side"].mode().iloc[0]),
        "instants": len(rows),
    }


def _velocity_numbers(evidence: Evidence, window: Window) -> dict[str, Any]:
    sums = evidence.sums["piv-cfd"]
    sums = sums[sums["time"].between(*window)]
    rms = _or_none(fields.rms_difference, sums)
    return {
        "velocity_rms_difference": rms,
        "velocity_rms_difference_relative": None if rms is None else rms / evidence.scale,
        "velocity_correlation": _or_none(fields.correlation, sums),
        "common_share_mean": float(sums["share"].mean()) if len(sums) else None,
    }


def _pair_numbers(evidence: Evidence, window: Window) -> dict[str, Any]:
    try:
        pair = tracks.within(paired(Part(evidence, "piv-cfd", window)), window)
    except ValueError:  # one of the two does not exist; the checks say which
        names = ("rms_difference", "mean_difference", "max_difference")
        nothing = {f"circulation_{name}": None for name in names}
        return nothing | {"centre_rms_distance": None, "centre_max_distance": None}
    reference = pair["circulation_reference"]
    signed = (pair["circulation_other"] - reference) * np.sign(reference) / reference.abs().mean()
    return {
        "circulation_rms_difference": tracks.circulation_difference(pair),
        "circulation_mean_difference": float(signed.mean()),
        "circulation_max_difference": float(signed.abs().max()),
        "centre_rms_distance": tracks.centre_distance(pair),
        "centre_max_distance": float(pair["centre_distance"].max()),
    }


def _or_none(measure: Callable[[pd.DataFrame], float], sums: pd.DataFrame) -> float | None:
    try:
        return measure(sums)
    except ValueError:  # nothing in common, or at rest; the checks say so
        return None
