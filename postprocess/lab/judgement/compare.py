"""Judge every quantity of a comparison, and what the verdicts say together."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import pandas as pd

from postprocess.lab.data.inputs_toml import Inputs
from postprocess.lab.judgement import validation as budget
from postprocess.lab.judgement.case import Case
from postprocess.lab.judgement.flow import flow_quantities, tables
from postprocess.lab.judgement.motion import at_recorded_motion, motion_quantities
from postprocess.lab.judgement.validation import ValidatedQuantity

MOTION = ("final_bend", "duration")  # what the silhouette shows


def compare(case: Case, inputs: Inputs) -> tuple[dict[str, Any], pd.DataFrame | None]:
    """Verdicts, and the flow's series over time (None: only the motion is compared).

    The flow is judged at the recording's own motion, where its effect is known.
    """
    case = at_recorded_motion(case)
    quantities, series = motion_quantities(case), None
    if case.flow is not None:
        measured = tables(case, case.flow)
        quantities += flow_quantities(case, case.flow, measured)
        series = pd.concat(
            [t.set_index("time").add_suffix(f"_{name}") for name, t in measured.items()], axis=1
        ).reset_index()
    level = budget.joint_level(len(quantities))
    rows = [judged(q, inputs.too_uncertain, level) for q in quantities]
    moves, flows = motion_verdict(rows), flow_verdict(rows)
    made = {e.of.name for e in case.effects}
    result = {
        "verdict": worst([moves, flows]),
        "motion": moves,
        "flow": flows,
        "too_uncertain": inputs.too_uncertain,
        "quantities": rows,
        "missing_runs": [one.name for one in inputs.all if one.name not in made],
    }
    return result, series


def motion_verdict(rows: list[dict[str, Any]]) -> str | None:
    """Whether the finger moves as simulated; None where that was not tested."""
    return worst([q["verdict"] for q in rows if q["name"] in MOTION])


def flow_verdict(rows: list[dict[str, Any]]) -> str | None:
    """Whether the flow is as simulated; it agrees only where its circulation is decided."""
    words = {q["name"]: q["verdict"] for q in rows if q["name"] not in MOTION}
    return budget.ERROR if budget.ERROR in words.values() else words.get("circulation")


def worst(words: list[str | None]) -> str | None:
    """The worst of some verdicts; None for none."""
    order = (budget.ERROR, budget.DIFFERS, budget.UNCERTAIN, budget.AGREES)
    return next((word for word in order if word in words), None)


def judged(q: ValidatedQuantity, too_uncertain: float, level: float) -> dict[str, Any]:
    """A quantity with its verdict, as comparison.json has it."""
    verdict = q.verdict(too_uncertain, level)
    if q.name in MOTION and verdict != budget.ERROR and q.differs(level):
        verdict = budget.DIFFERS
    return {
        **asdict(q),
        "error": q.error,
        "u_val": q.u_val,
        "k": budget.coverage_factor(q.error.size, level),
        **{symbol: q.u_kind(kind) for kind, symbol in budget.KINDS.items()},
        "significance": q.significance(),
        "verdict": verdict,
        "detectable": q.detectable(level),
        "dominant": q.dominant.name,
    }
