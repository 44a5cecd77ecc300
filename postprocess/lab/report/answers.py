"""The page's answers in words, and its table: of the motion, of the flow, and what is to blame."""

from __future__ import annotations

from typing import Any

import numpy as np

from postprocess.lab.judgement.compare import MOTION
from postprocess.lab.judgement.validation import AGREES, DIFFERS, ERROR, UNCERTAIN
from postprocess.words import NBSP, pair, size

Quantity = dict[str, Any]
WORDS = {
    AGREES: "yes",
    ERROR: "no",
    UNCERTAIN: "cannot be said",
    DIFFERS: "no, but within what is known of the inputs",
    None: "not tested",
}
BLAME = {
    "numerical": "mesh or time step",
    "input": "the inputs (pressure, time, geometry, material)",
    "data": "the measurement",
}


def answer(result: dict[str, Any]) -> str:
    """The page's first sentences on motion and flow, their evidence, and what is to blame."""
    motion = [q for q in result["quantities"] if q["name"] in MOTION]
    flow = [q for q in result["quantities"] if q["name"] not in MOTION]
    wrong = [q for q in flow if q["verdict"] == ERROR]
    moves = result["motion"]
    parts = [f"Motion: {WORDS[moves]}. Flow: {WORDS[result['flow']]}."]
    if moves is None:
        parts.append("Vectors do not show the finger: whether it moved as simulated is not tested.")
    elif moves == UNCERTAIN:
        parts.append(f"Too uncertain to say: {_undecided(motion)}.")
    else:
        parts.append(_listed(motion, moves) or "The finger moves as simulated.")
    wide = _undecided(flow)
    if wrong:
        parts.append(_listed(flow, ERROR))
    elif result["flow"] == UNCERTAIN:
        share = f"{result['too_uncertain']:.0%}"
        parts.append(f"A flow that errs by {share} would not be seen: {wide}.")
    elif result["flow"]:
        parts.append(f"Nothing can be said of: {wide}." if wide else "The flow agrees.")
    if moves == ERROR:
        parts.append(_blame_of_motion(result["registration"]))
    elif moves == DIFFERS:
        rate = "check frame_rate_hz of dpiv.toml, then " if motion[-1]["verdict"] == DIFFERS else ""
        parts.append(f"To find out, {rate}correct motion.strokes of the scene.")
    if wrong:
        parts.append(_blame_of_flow(moves, wrong))
    if flow and (missing := result["missing_runs"]):
        lacks = " and ".join(name for name in missing if name in ("grid", "time_step"))
        added = f", and S lacks what {lacks} would change" if lacks else ""
        parts.append(
            f"Not in u_val, because these runs were not made: {', '.join(missing)}{added};"
            " differences are judged too strictly."
        )
    return " ".join(part for part in parts if part)


def _listed(quantities: list[Quantity], verdict: str) -> str:
    """The quantities of a verdict that is not `AGREES`, with their differences."""
    found = [q for q in quantities if q["verdict"] == verdict != AGREES]
    text = "; ".join(f"{q['label']}: {verdict_sentence(q)}" for q in found)
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _undecided(quantities: list[Quantity]) -> str:
    """Undecided quantities with the error that would be found, and the largest uncertainty."""
    return ", ".join(
        f"{q['label']} (errors above {_relative(q)} would be found, mostly {q['dominant']})"
        for q in quantities
        if q["verdict"] == UNCERTAIN
    )


def _blame_of_motion(registration: dict[str, Any]) -> str:
    """What of pressure and time differs by more than the registration leaves open."""
    parts = []
    for name, verb, up, down, what in (
        ("pressure_factor", "bends as if its pressure were", "higher", "lower", ""),
        ("stretch", "takes", "more", "less", " time"),
    ):
        value, band = 100 * (registration[name] - 1), 196 * registration[f"{name}_std"]
        if abs(value) > band:
            change = f"{abs(value):.1f}{NBSP}% {up if value > 0 else down}{what}"
            parts.append(f"{verb} {change} (±{NBSP}{band:.1f})")
    rate = "If frame_rate_hz of dpiv.toml is right, the" if "takes" in "".join(parts) else "The"
    return f"{rate} motion is to blame: the recording's finger {' and '.join(parts)}."


def _blame_of_flow(moves: str | None, wrong: list[Quantity]) -> str:
    """The cause of a flow that differs in the quantities `wrong`."""
    if moves is None:
        return "The flow model is to blame, or a motion other than the simulated one."
    if any(q["explained"] is not None for q in wrong):
        names = ", ".join(q["label"] for q in wrong)
        text = f"At the recording's own motion the flow differs ({names}): the flow model is to"
        return f"{text} blame."
    if moves == AGREES:
        return "The finger moves as simulated, so the flow model is to blame, not the motion."
    return (
        "Whether motion or flow model is to blame is not known: the motion's effect on the flow"
        " needs the runs pressure and duration."
    )


def verdict_sentence(q: Quantity) -> str:
    """One quantity's verdict in a sentence."""
    unit, off = q["unit"], size(q["error"], q["unit"])
    off += f" ({np.linalg.norm(q['error']) / abs(q['scale']):.0%})" if q["scale"] else ""
    band = f"±{NBSP}{size(q['k'] * np.asarray(q['u_val']), unit)}"
    if q["verdict"] == AGREES:
        return f"agrees within {band}"
    if q["verdict"] == ERROR:
        what = "the motion differs by" if q["name"] in MOTION else "model error of"
        return f"{what} about {off}, known to {band}"
    if q["verdict"] == DIFFERS:
        seen = f"±{NBSP}{size(q['k'] * np.asarray(q['u_D']), unit)}"
        return f"differs by {off}, known to {seen}, which the inputs' uncertainty allows ({band})"
    return f"too uncertain to say: the band is {band}, mostly from {q['dominant']}"


def _relative(q: Quantity) -> str:
    """The smallest error that is found with 95 %, in per cent of the quantity; a place's in mm."""
    if np.size(q["error"]) > 1 or not q["scale"]:
        return size(q["detectable"], q["unit"])
    return f"{100 * q['detectable'] / abs(q['scale']):.0f}{NBSP}%"


def row(q: Quantity) -> dict[str, Any]:
    """A row of the table of verdicts as text."""
    unit = q["unit"]
    source = next(s for s in q["sources"] if s["name"] == q["dominant"])
    return {
        "label": q["label"],
        "window": q["window"],
        **{name: pair(q[name], unit) for name in ("simulation", "data", "error")},
        **{name: pair(q[name], unit) for name in ("explained", "finer")},
        **{name: size(q[name], unit) for name in ("u_num", "u_input", "u_D", "u_val")},
        "significance": f"{q['significance']:.2f}",
        "k": f"{q['k']:.2f}",
        "verdict": q["verdict"],
        "detectable": f"{size(q['detectable'], unit)} ({_relative(q)})",
        "sentence": verdict_sentence(q),
        "dominant": f"{q['dominant']} ({BLAME[source['kind']]})",
        "sources": [(s["name"], s["kind"], size(s["std"], unit), s["how"]) for s in q["sources"]],
    }
