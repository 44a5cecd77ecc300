"""Numbers, verdicts and tables of a comparison as text in a laboratory's units."""

from __future__ import annotations

from typing import Any

import numpy as np

from postprocess.lab.judgement.compare import MOTION
from postprocess.words import NBSP, pair, size

BLAME = {
    "numerical": "mesh or time step",
    "input": "the inputs (pressure, time, geometry, material)",
    "data": "the measurement",
}


def verdict_sentence(q: dict[str, Any]) -> str:
    """One quantity's verdict in a sentence."""
    band = size(q["k"] * np.asarray(q["u_val"]), q["unit"])
    if q["verdict"] == "agrees":
        return f"agrees within ±{NBSP}{band}"
    if q["verdict"] == "model error":
        what = "the motion differs by" if q["name"] in MOTION else "model error of"
        return f"{what} about {size(q['error'], q['unit'])}{part_of(q)}, known to ±{NBSP}{band}"
    return f"too uncertain to say: the band is ±{NBSP}{band}, mostly from {q['dominant']}"


def part_of(q: dict[str, Any]) -> str:
    """The difference in per cent of the quantity's scale."""
    return f" ({np.linalg.norm(q['error']) / abs(q['scale']):.0%})" if q["scale"] else ""


def relative(q: dict[str, Any]) -> str:
    """The smallest error that is found with 95 %, in per cent of the quantity; a place's in mm."""
    if np.size(q["error"]) > 1 or not q["scale"]:
        return size(q["detectable"], q["unit"])
    return f"{100 * q['detectable'] / abs(q['scale']):.0f}{NBSP}%"


def rows(result: dict[str, Any]) -> list[dict[str, Any]]:
    """The table of verdicts as text."""
    return [_row(q) for q in result["quantities"]]


def _row(q: dict[str, Any]) -> dict[str, Any]:
    unit, found = q["unit"], q["detectable"]
    source = next(s for s in q["sources"] if s["name"] == q["dominant"])
    return {
        "label": q["label"],
        **{name: pair(q[name], unit) for name in ("simulation", "direct", "data", "error")},
        "measurement": pair(q["measurement_part"], unit),
        "explained": pair(q["explained_by_motion"], unit),
        "finer": pair(q["finer"], unit),
        **{name: size(q[name], unit) for name in ("u_num", "u_input", "u_D", "u_val")},
        "significance": f"{q['significance']:.2f}",
        "k": f"{q['k']:.2f}",
        "verdict": q["verdict"],
        "detectable": f"{size(found, unit)} ({relative(q)})",
        "sentence": verdict_sentence(q),
        "dominant": f"{q['dominant']} ({BLAME[source['kind']]})",
        "sources": [(s["name"], s["kind"], size(s["std"], unit), s["how"]) for s in q["sources"]],
    }
