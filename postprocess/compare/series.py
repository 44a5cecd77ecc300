"""The comparison as series over time and as key numbers over the instants that are judged."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from postprocess.compare.quantities import paired
from postprocess.evidence import fields
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.evidence import Evidence, Part
from postprocess.evidence.time_windows import Clock

_Window = tuple[float, float]
REST = 0.01  # of the scale; a correlation of slower fields says nothing


def series_table(evidence: Evidence, window: _Window) -> pd.DataFrame:
    """Series at the PIV's instants, or the CFD's; empty cells where a vortex does not exist."""
    times = evidence.planes["piv" if evidence.has("piv") else "cfd"]["time"].values
    cfd = evidence.planes["cfd"]
    bend = np.degrees(np.interp(times, cfd["time"].values, cfd["bend"].values[:, 0]))
    table = pd.DataFrame({"time": times, "bend_deg": bend})
    for source, track in tracks.dominant_tracks(evidence.vortices, 0, window).items():
        there = (times >= track["time"].iloc[0] - 1e-9) & (times <= track["time"].iloc[-1] + 1e-9)
        for name in (
            n for n in (*tracks.COMPARED, "circulation_std", "circulation_fit") if n in track
        ):
            values = np.interp(times, track["time"], track[name].astype(float))
            table[f"{name}_{source}"] = pd.Series(values).where(there)
    if "piv-cfd" in evidence.sums:
        velocity = fields.field_series(evidence.sums["piv-cfd"], REST * evidence.scale)
        table = table.merge(velocity, on="time", how="left")
    if {"x_cfd", "x_piv"} <= set(table.columns):
        dx, dy = (table[f"{axis}_piv"] - table[f"{axis}_cfd"] for axis in "xy")
        table["centre_distance"] = np.hypot(dx, dy)
    return table


def summary(evidence: Evidence, window: _Window) -> dict[str, Any]:
    """Key numbers over a window, by source and of PIV against CFD; None: not measurable."""
    tips = tracks.dominant_tracks(evidence.vortices, 0, window)
    out: dict[str, Any] = {
        source: {
            "circulation_mean": means["circulation"],
            "side": str(tips[source].loc[tips[source]["time"].between(*window), "side"].mode()[0]),
            "instants": means["instants"],
        }
        for source, means in tracks.common_means(tips, window).items()
    }
    if "piv-cfd" in evidence.sums:
        pair = _or_none(paired, Part(evidence, "piv-cfd", window))
        out["piv-cfd"] = _velocity_numbers(evidence, window) | _pair_numbers(pair)
    return out


def closing(clock: Clock) -> dict[str, float | None]:
    """When the tips of a pinch meet (s; None: never), gaps (m), and the speed of closing (m/s)."""
    time, gap = clock.gaps()
    return {
        "contact_time": clock.met(),
        "residual_gap": clock.residual_gap,
        "least_gap": float(gap.min()),
        "peak_closing_speed": float(-(np.gradient(gap, time).min())),
    }


def _velocity_numbers(evidence: Evidence, window: _Window) -> dict[str, Any]:
    sums = evidence.sums["piv-cfd"]
    sums = sums[sums["time"].between(*window)]
    rms = _or_none(fields.rms_difference, sums)
    return {"velocity_rms_difference_relative": None if rms is None else rms / evidence.scale}


def _pair_numbers(pair: pd.DataFrame | None) -> dict[str, Any]:
    names = (
        "circulation_rms_difference",
        "circulation_max_difference",
        "centre_rms_distance",
        "centre_max_distance",
        "instants",
        "circulation_instants",
    )
    out: dict[str, Any] = dict.fromkeys(names)
    if pair is None:
        return out
    known = pair[pair["known"]]
    out["instants"], out["circulation_instants"] = len(pair), len(known)
    out["centre_rms_distance"] = tracks.centre_distance(pair)
    out["centre_max_distance"] = float(pair["centre_distance"].max())
    if len(known) >= tracks.ENOUGH * len(pair):
        reference = known["circulation_reference"]
        off = (known["circulation_other"] - reference).abs() / reference.abs().mean()
        out["circulation_rms_difference"] = tracks.relative_difference(known, "circulation")
        out["circulation_max_difference"] = float(off.max())
    return out


def _or_none(measure: Callable[[Any], Any], of: Any) -> Any:
    """What is measured; None where it cannot be, for which the checks say the reason."""
    try:
        return measure(of)
    except ValueError:
        return None
