"""Key numbers of a pinch, by source: both pairs, the jet, the pressure of closing, before and after contact."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from postprocess.evidence.evidence import Evidence
from postprocess.evidence.half_planes import BELOW, names_at
from postprocess.evidence.pair_integrals import DORSAL, LATE, VENTRAL, formed, pair_of
from postprocess.evidence.time_windows import Clock
from postprocess.evidence.vortex_pairs import rms

APPROACH = (
    0.020,
    0.005,
)  # m of gap between tip and plane, as of the findings; nearer the fitted cores overlap
AFTER = 0.15  # s after contact
BEFORE = 0.25  # s before it: a vortex of an opening stroke is older


def pinch_summary(evidence: Evidence) -> dict[str, Any]:
    """Contact and gaps (s, m), and by source the numbers of `source_numbers`; `contact_time` None without contact."""
    clock = evidence.clock
    time, gap = clock.gaps()
    met = clock.met()
    out: dict[str, Any] = {
        "contact_time": met,
        "residual_gap": clock.residual_gap,
        "least_gap": float(gap.min()),
        "peak_closing_speed": float(-(np.gradient(gap, time).min())),
    }
    for source, pairs in evidence.pairs.items():
        out[source] = source_numbers(pairs, evidence.lines[source], clock, met)
        width = evidence.planes[source].attrs["tip_width"]
        out[source] |= integral_numbers(
            evidence.integrals[source], evidence.halves[source], clock, met, width
        )
    return out


def source_numbers(
    pairs: pd.DataFrame, lines: pd.DataFrame, clock: Clock, met: float | None
) -> dict[str, float | None]:
    """Peaks of jet, pressure and circulation with the time and gap at each, and means over the approach; None: not there."""
    gap = clock.gap_at(lines["time"].to_numpy())
    approach = lines[(gap <= APPROACH[0]) & (gap >= APPROACH[1])]["time"]
    out: dict[str, float | None] = {}
    for name, column in (
        ("jet", "jet_speed"),
        ("rise", "rise_speed"),
        ("pressure_gap", "pressure_gap"),
        ("pressure_tip_max", "pressure_tip_max"),
        ("pressure_tip_min", "pressure_tip_min"),
    ):
        if column not in lines or lines[column].isna().all():
            continue
        k = int(lines[column].abs().idxmax())
        out[f"{name}_peak"] = float(lines[column][k])
        out[f"{name}_peak_time"], out[f"{name}_peak_gap"] = float(lines["time"][k]), float(gap[k])
    then = lines[lines["time"].between(met, met + AFTER)] if met is not None else lines[:0]
    out["jet_peak_after_contact"] = _number(then["jet_speed"].max())
    rows = pairs[pairs["time"].isin(approach)]
    size = 0.5 * (pairs["circulation_0"].abs() + pairs["circulation_1"].abs())
    out["circulation_peak"] = _number(size[rows.index].max())
    out["imbalance_rms"] = rms(rows["imbalance"]) if len(rows) else None
    out["mirror_distance_rms"] = rms(rows["mirror_distance"]) if len(rows) else None
    clear = pd.concat(
        [rows[f"x_{finger}"].abs() / rows[f"core_radius_{finger}"] for finger in (0, 1)]
    )
    out["core_radii_from_plane_approach"] = _number(clear.min())
    for name in ("along_tip", "across_tip"):
        both = 0.5 * (pairs[f"{name}_0"] + pairs[f"{name}_1"])
        out[f"{name}_approach"] = _number(both[rows.index].mean())
    out["stagnation_y_approach"] = _number(lines["stagnation_y"][approach.index].mean())
    return out


def integral_numbers(
    integrals: pd.DataFrame, halves: pd.DataFrame, clock: Clock, met: float | None, width: float
) -> dict[str, float | None]:
    """Numbers that no fit is asked for, from BEFORE contact until LATE: both pairs, each half of the plane, the jet; None: not there.

    `width`: of a tip (m).
    """
    if met is not None:
        near = (met - BEFORE, met + LATE)
        integrals, halves = (table[table["time"].between(*near)] for table in (integrals, halves))
    ventral, dorsal = pair_of(integrals, *VENTRAL), pair_of(integrals, *DORSAL)
    at = formed(halves["time"].to_numpy(), ventral, width)
    out: dict[str, float | None] = {"ventral_forms_time": at, "ventral_forms_gap": None}
    out["ventral_forms_before_contact"] = None if at is None or met is None else met - at
    out["ventral_circulation_peak"] = out["ventral_part"] = out["ventral_rise_peak"] = None
    if at is not None:
        out["ventral_forms_gap"] = float(clock.gap_at(np.array([at]))[0])
        since = ventral[ventral["time"] >= at]
        k = int(since["circulation"].idxmax())
        if k < since.index[-1]:  # what still grows where the window ends has no peak in it
            out["ventral_circulation_peak"] = float(since["circulation"][k])
            out["ventral_circulation_peak_time"] = float(since["time"][k])
            out["ventral_circulation_peak_gap"] = float(
                clock.gap_at(since["time"][[k]].to_numpy())[0]
            )
            then = _at(dorsal["time"], dorsal["circulation"], since["time"][k])
            out["ventral_part"] = None if then is None else float(since["circulation"][k]) / then
        out["ventral_rise_peak"] = _number(since["between"].max())
    for name, when in (("at_contact", 0.0), ("after", AFTER)):
        out[f"dorsal_circulation_{name}"] = _late(dorsal, "circulation", met, when)
        out[f"ventral_circulation_{name}"] = _late(ventral, "circulation", met, when)
    out["dorsal_from_plane_after"] = _late(dorsal.assign(x=-dorsal["x"]), "x", met, AFTER)
    out["dorsal_y_after"] = _late(dorsal, "y", met, AFTER)
    mean = halves.assign(circulation=0.5 * (halves["circulation_1"] - halves["circulation_0"]))
    mean["impulse"] = 0.5 * (halves["impulse_0"] + halves["impulse_1"])
    out["half_circulation_after"] = _late(mean, "circulation", met, AFTER)
    out["half_impulse_after"] = _late(mean, "impulse", met, AFTER)
    for name in (name for depth in BELOW for name in names_at(depth)):
        out[f"{name}_peak"] = _number(halves[name].max())
    return out


def _late(table: pd.DataFrame, name: str, met: float | None, after: float) -> float | None:
    """A column so long (s) after contact; None without contact or without a row there."""
    return None if met is None else _at(table["time"], table[name], met + after)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _at(time: pd.Series, values: pd.Series, when: float) -> float | None:
    """Linear in time; None more than 10 ms from any row."""
    if len(time) == 0 or np.abs(time - when).min() > 0.01:
        return None
    return float(np.interp(when, time, values))
