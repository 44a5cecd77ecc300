"""From a recording's case to its quantities, and from repeats to the verdict: comparison.json."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pandas as pd

from piv.files.atomic import sha256
from postprocess.lab.dpiv_toml import NAME, Dpiv
from postprocess.lab.flow import corrected, flow_quantities
from postprocess.lab.inputs import level_uncertainty
from postprocess.lab.motion import Comparison, motion_quantities
from postprocess.lab.recorded import recording_quality
from postprocess.lab.validation import ValidatedQuantity, joint_level, judged, repeated, verdicts


@dataclass(frozen=True)
class Compared:
    """One recording's case, its quantities, and the flow's series over time (None: no flow)."""

    dpiv: Dpiv
    case: Comparison
    quantities: list[ValidatedQuantity]
    series: pd.DataFrame | None


def compare(dpiv: Dpiv, case: Comparison) -> Compared:
    """The quantities of one recording; the flow's at the recording's own motion, where known."""
    quantities, series = motion_quantities(case), None
    if case.flow is not None:
        quantities += flow_quantities(case, case.flow)
        shown = case.measured | {"corrected": corrected(case)}
        series = pd.concat(
            [t.set_index("time").add_suffix(f"_{name}") for name, t in shown.items()], axis=1
        ).reset_index()
    return Compared(dpiv, case, quantities, series)


def summary(compared: list[Compared]) -> dict[str, Any]:
    """comparison.json of one recording or of repeats, as far as they decide it."""
    shared = [q.name for q in compared[0].quantities]
    by_name = [{q.name: q for q in one.quantities} for one in compared]
    shared = [name for name in shared if all(name in one for one in by_name)]
    means = [repeated([one[name] for one in by_name]) for name in shared]
    rows = [judged(q, joint_level(len(means))) for q in means]
    first, flow = compared[0], compared[0].case.flow
    during = next((q.window for q in means if q.window), (0.0, 0.0))
    levels = first.case.levels
    return {
        "quantities": rows,
        "levels": {
            level: level_uncertainty(levels, level, during) for level in levels["run"].unique()
        },
        **verdicts(rows),
        "all_water": first.case.all_water,
        "water_speed": first.case.water_speed,
        "data": ", ".join(one.dpiv.title for one in compared),
        "registration": first.case.registration.summary(),
        "quality": recording_quality(
            first.dpiv, first.case.registration, flow.data if flow else None
        ),
        "repeats": [
            {
                "title": one.dpiv.title,
                "registration": one.case.registration.summary(),
                "errors": {name: of[name].error for name in shared},
            }
            for one, of in zip(compared, by_name, strict=True)
        ],
        "provenance": {
            "dpiv_sha256": [sha256(one.dpiv.folder / NAME) for one in compared],
            "settings": {
                one.dpiv.title: one.dpiv.model_dump(mode="json", exclude={"folder"})
                for one in compared
            },
        },
    }
