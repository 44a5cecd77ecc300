"""The page's answers in words, and its table: of the motion, of the flow, and what is to blame."""

from __future__ import annotations

from typing import Any

import numpy as np

from postprocess.lab.judgement.compare import MOTION
from postprocess.words import NBSP, pair, size

Quantity = dict[str, Any]
WORDS = {
    "agrees": "yes",
    "model error": "no",
    "too uncertain": "cannot be said",
    "differs within the inputs": "no, but within what is known of the inputs",
    None: "not tested",
}
UNKNOWN_EFFECT = "The effect on the flow is not known without the runs pressure and duration."
BLAME = {
    "numerical": "mesh or time step",
    "input": "the inputs (pressure, time, geometry, material)",
    "data": "the measurement",
}


def answer(result: dict[str, Any]) -> str:
    """The page's first sentences on motion and flow, their evidence, and what is to blame."""
    motion = [q for q in result["quantities"] if q["name"] in MOTION]
    flow = [q for q in result["quantities"] if q["name"] not in MOTION]
    parts = [
        f"Motion: {WORDS[result['motion']]}. Flow: {WORDS[result['flow']]}.",
        _motion_answer(result, motion, flow),
        _flow_answer(result, flow),
    ]
    if result["motion"] == "model error":
        parts += [_blame_of_motion(result["registration"]), _motion_effect(flow)]
    if wrong := [q for q in flow if q["name"] in result["wrong"]]:
        parts.append(_blame_of_flow(result, wrong))
    if missing := result["missing_runs"]:
        lacks = " and ".join(name for name in missing if name in ("grid", "time_step"))
        added = f", and S lacks what {lacks} would change" if lacks else ""
        parts.append(
            f"Not in u_val, because these runs were not made: {', '.join(missing)}{added};"
            " differences are judged too strictly."
        )
    return " ".join(part for part in parts if part)


def _motion_answer(result: dict[str, Any], motion: list[Quantity], flow: list[Quantity]) -> str:
    """The motion by the silhouette, and how small a difference it would have shown."""
    if result["motion"] is None:
        return "Vectors do not show the finger: whether it moved as simulated is not tested."
    if result["motion"] == "model error":
        return _listed(result, motion)
    if result["motion"] == "agrees":
        return "The finger moves as simulated."
    if result["motion"] == "too uncertain":
        return f"Too uncertain to say: {_undecided(motion)}."
    differs = "; ".join(
        f"{q['label']} {size(q['simulation'], q['unit'])} against {size(q['data'], q['unit'])}"
        f"{_part_of(q)}, which the registration knows to"
        f" ±{NBSP}{size(q['k'] * np.asarray(q['u_D']), q['unit'])}"
        for q in motion
        if q["differs"]
    )
    rate = "check frame_rate_hz of dpiv.toml, then " if "duration" in differs else ""
    return (
        f"The recording's finger moves otherwise than the simulated one: {differs}. The inputs'"
        f" uncertainty allows for it (u_input), so it is no fault of the model: {rate}correct"
        f" motion.strokes of the scene. {_motion_effect(flow)}"
    )


def _flow_answer(result: dict[str, Any], flow: list[Quantity]) -> str:
    """The flow by the quantities that could have shown a difference."""
    if any(q["name"] in result["wrong"] for q in flow):
        return _listed(result, flow)
    wide = _undecided(flow)
    if result["flow"] == "too uncertain":
        return f"A flow that errs by {result['too_uncertain']:.0%} would not be seen: {wide}."
    return f"The flow agrees. Nothing can be said of: {wide}." if wide else "The flow agrees."


def _listed(result: dict[str, Any], quantities: list[Quantity]) -> str:
    wrong = [q for q in quantities if q["name"] in result["wrong"]]
    text = "; ".join(f"{q['label']}: {verdict_sentence(q)}" for q in wrong)
    return f"{text[:1].upper()}{text[1:]}."


def _undecided(quantities: list[Quantity]) -> str:
    """Undecided quantities with the error that would be found, and the largest uncertainty."""
    return ", ".join(
        f"{q['label']} (errors above {_relative(q)} would be found, mostly {q['dominant']})"
        for q in quantities
        if q["verdict"] == "too uncertain"
    )


def _blame_of_motion(registration: dict[str, Any]) -> str:
    def more(name: str, up: str, down: str) -> str:
        value, band = registration[name], 196 * registration[f"{name}_std"]
        change = f"{100 * abs(value - 1):.1f}{NBSP}% {up if value >= 1 else down}"
        return f"{change} (±{NBSP}{band:.1f})"

    time, std = registration["stretch"], registration["stretch_std"]
    rate = "If frame_rate_hz of dpiv.toml is right, the" if abs(time - 1) > 1.96 * std else "The"
    return (
        f"{rate} motion is to blame: the recording's finger bends as if its pressure were"
        f" {more('pressure_factor', 'higher', 'lower')} than the simulation's, and takes"
        f" {more('stretch', 'more', 'less')} time."
    )


def _blame_of_flow(result: dict[str, Any], wrong: list[Quantity]) -> str:
    """The cause of a flow that differs in the quantities `wrong`."""
    if result["motion"] is None:
        return "The flow model is to blame, or a motion other than the simulated one."
    if any(q["explained_by_motion"] is not None for q in wrong):
        names = ", ".join(q["label"] for q in wrong)
        text = f"At the recording's own motion the flow differs ({names}): the flow model is to"
        return f"{text} blame."
    if result["motion"] == "agrees":
        return "The finger moves as simulated, so the flow model is to blame, not the motion."
    return f"Whether motion or flow model is to blame is not known. {UNKNOWN_EFFECT}"


def _motion_effect(flow: list[Quantity]) -> str:
    """Effect of the motion's difference on the flow, by the runs of pressure and duration."""
    parts = []
    for q in flow:
        values = np.atleast_1d(np.asarray(q["explained_by_motion"], float))
        if q["explained_by_motion"] is not None:
            share = f"{100 * values[0] / abs(q['scale']):+.0f}{NBSP}%"
            parts.append(f"{q['label']} {share if values.size == 1 else size(values, q['unit'])}")
    if not parts:
        return UNKNOWN_EFFECT
    return (
        "By the runs of pressure and duration that motion makes this part of the flow's"
        f" differences, as PIV shows them, which is taken out: {', '.join(parts)}."
    )


def verdict_sentence(q: Quantity) -> str:
    """One quantity's verdict in a sentence."""
    band = size(q["k"] * np.asarray(q["u_val"]), q["unit"])
    if q["verdict"] == "agrees":
        return f"agrees within ±{NBSP}{band}"
    if q["verdict"] == "model error":
        what = "the motion differs by" if q["name"] in MOTION else "model error of"
        return f"{what} about {size(q['error'], q['unit'])}{_part_of(q)}, known to ±{NBSP}{band}"
    return f"too uncertain to say: the band is ±{NBSP}{band}, mostly from {q['dominant']}"


def _part_of(q: Quantity) -> str:
    """The difference in per cent of the quantity's scale."""
    return f" ({np.linalg.norm(q['error']) / abs(q['scale']):.0%})" if q["scale"] else ""


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
        "explained": pair(q["explained_by_motion"], unit),
        "finer": pair(q["finer"], unit),
        **{name: size(q[name], unit) for name in ("u_num", "u_input", "u_D", "u_val")},
        "significance": f"{q['significance']:.2f}",
        "k": f"{q['k']:.2f}",
        "verdict": q["verdict"],
        "detectable": f"{size(q['detectable'], unit)} ({_relative(q)})",
        "sentence": verdict_sentence(q),
        "dominant": f"{q['dominant']} ({BLAME[source['kind']]})",
        "sources": [(s["name"], s["kind"], size(s["std"], unit), s["how"]) for s in q["sources"]],
    }
