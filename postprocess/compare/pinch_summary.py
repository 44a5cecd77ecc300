"""Key numbers of a pinch, by source: the pair, the jet, the pressure of closing, before and after contact."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from postprocess.evidence.evidence import Evidence
from postprocess.evidence.time_windows import Clock
from postprocess.evidence.vortex_pairs import rms

APPROACH = (0.020, 0.002)  # m of gap between tip and plane
AFTER = 0.15  # s after contact


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
    out["circulation_peak"] = _number(size.max())
    out["circulation_at_contact"] = None if met is None else _at(pairs["time"], size, met)
    out["imbalance_rms"] = rms(rows["imbalance"]) if len(rows) else None
    out["mirror_distance_rms"] = rms(rows["mirror_distance"]) if len(rows) else None
    for name in ("along_tip", "across_tip"):
        both = 0.5 * (pairs[f"{name}_0"] + pairs[f"{name}_1"])
        out[f"{name}_approach"] = _number(both[rows.index].mean())
        out[f"{name}_after"] = None if met is None else _at(pairs["time"], both, met + AFTER)
    out["stagnation_y_approach"] = _number(lines["stagnation_y"][approach.index].mean())
    return out


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _at(time: pd.Series, values: pd.Series, when: float) -> float | None:
    """Linear in time; None more than 10 ms from any row."""
    if len(time) == 0 or np.abs(time - when).min() > 0.01:
        return None
    return float(np.interp(when, time, values))
