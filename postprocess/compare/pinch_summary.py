"""Key numbers of a pinch, by source: both pairs, the jet, and the pressure of closing."""

from typing import Any

import numpy as np
import pandas as pd

from postprocess.evidence.evidence import Evidence
from postprocess.evidence.pair_integrals import DORSAL, LATE, VENTRAL, formed, pair_of
from postprocess.evidence.time_windows import APPROACH, Clock
from postprocess.evidence.tip_vortex import common_instants, rms

AFTER = 0.15  # s after contact
_BEFORE = 0.25  # s before it: a vortex of an opening stroke is older
_Numbers = dict[str, float | None]


def pinch_summary(evidence: Evidence) -> dict[str, Any]:
    """Contact and gaps (s, m), and the numbers of each source; None: not there."""
    clock = evidence.clock
    time, gap = clock.gaps()
    met = clock.met()
    out: dict[str, Any] = {
        "contact_time": met,
        "residual_gap": clock.residual_gap,
        "least_gap": float(gap.min()),
        "peak_closing_speed": float(-(np.gradient(gap, time).min())),
    }
    tables = {"pairs": evidence.pairs, "lines": evidence.lines}
    if len(evidence.pairs) == 2:  # both columns of the page are of the same instants
        for name, (cfd, piv) in {k: tuple(of.values()) for k, of in tables.items()}.items():
            tables[name] = dict(zip(tables[name], common_instants(cfd, piv), strict=True))
    for source, pairs in tables["pairs"].items():
        width = evidence.planes[source].attrs["tip_width"]
        lines = tables["lines"][source]
        out[source] = _source_numbers(pairs, lines, clock, met)
        times = evidence.lines[source]["time"].to_numpy()
        out[source] |= integral_numbers(times, evidence.integrals[source], clock, met, width)
    return out


def _source_numbers(
    pairs: pd.DataFrame, lines: pd.DataFrame, clock: Clock, met: float | None
) -> _Numbers:
    """Peaks of jet, pressure and circulation with time and gap, and means over the approach."""
    gap = clock.gap_at(lines["time"].to_numpy())
    approach = lines[(gap <= APPROACH[0]) & (gap >= APPROACH[1])]["time"]
    out: _Numbers = {}
    columns = {"jet": "jet_speed", "rise": "rise_speed"}
    for name in ("jet", "rise", "pressure_gap"):
        column = columns.get(name, name)
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
    for name in ("imbalance", "mirror_distance"):
        out[f"{name}_rms"] = rms(rows[name]) if len(rows) else None
    for name in ("along_tip", "across_tip"):
        both = 0.5 * (pairs[f"{name}_0"] + pairs[f"{name}_1"])
        out[f"{name}_approach"] = _number(both[rows.index].mean())
    out["stagnation_y_approach"] = _number(lines["stagnation_y"][approach.index].mean())
    return out


def integral_numbers(
    times: np.ndarray, integrals: pd.DataFrame, clock: Clock, met: float | None, width: float
) -> _Numbers:
    """Both pairs over the `times` (s) of a source; `width` of a tip (m).

    From 0.25 s before contact until 0.3 s after it.
    """
    if met is not None:
        near = (met - _BEFORE, met + LATE)
        integrals = integrals[integrals["time"].between(*near)]
        times = times[(times >= near[0]) & (times <= near[1])]
    ventral, dorsal = pair_of(integrals, *VENTRAL), pair_of(integrals, *DORSAL)
    at = formed(times, ventral, width)
    out: _Numbers = {"ventral_forms_time": at, "ventral_forms_gap": None}
    out["ventral_circulation_peak"] = out["ventral_part"] = out["ventral_rise_peak"] = None
    if at is not None:
        out["ventral_forms_gap"] = float(clock.gap_at(np.array([at]))[0])
        since = ventral[ventral["time"] >= at]
        k = int(since["circulation"].idxmax())
        if k < since.index[-1]:  # what still grows where the window ends has no peak in it
            peak, time = float(since["circulation"][k]), float(since["time"][k])
            out["ventral_circulation_peak"], out["ventral_circulation_peak_time"] = peak, time
            out["ventral_circulation_peak_gap"] = float(clock.gap_at(np.array([time]))[0])
            then = _at(dorsal, "circulation", time)
            out["ventral_part"] = None if then is None else peak / then
        out["ventral_rise_peak"] = _number(since["between"].max())
    after = None if met is None else met + AFTER
    out["dorsal_circulation_at_contact"] = _at(dorsal, "circulation", met)
    out["dorsal_circulation_after"] = _at(dorsal, "circulation", after)
    out["ventral_circulation_after"] = _at(ventral, "circulation", after)
    out["dorsal_from_plane_after"] = _at(dorsal.assign(x=-dorsal["x"]), "x", after)
    out["dorsal_y_after"] = _at(dorsal, "y", after)
    return out


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _at(table: pd.DataFrame, name: str, when: float | None) -> float | None:
    """A column at a time (s), linear between rows; None more than 10 ms from any row."""
    time = table["time"]
    if when is None or len(time) == 0 or np.abs(time - when).min() > 0.01:
        return None
    return float(np.interp(when, time, table[name]))
