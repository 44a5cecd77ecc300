"""The page's answers in words: of the motion, of the flow, and what is to blame."""

from __future__ import annotations

from typing import Any

import numpy as np

from postprocess.lab.judgement.compare import MOTION
from postprocess.lab.report.wording import part_of, relative, verdict_sentence
from postprocess.words import NBSP, size

Quantity = dict[str, Any]
WORDS = {
    "agrees": "yes",
    "model error": "no",
    "too uncertain": "cannot be said",
    "differs within the inputs": "no, but within what is known of the inputs",
    None: "not tested",
}
UNKNOWN_EFFECT = "The effect on the flow is not known without the runs pressure and duration."


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
    if wrong := _wrong(result, flow):
        parts.append(_blame_of_flow(result, wrong))
    return " ".join(part for part in [*parts, _incomplete(result)] if part)


def _wrong(result: dict[str, Any], quantities: list[Quantity]) -> list[Quantity]:
    return [q for q in quantities if q["name"] in result["wrong"]]


def _motion_answer(result: dict[str, Any], motion: list[Quantity], flow: list[Quantity]) -> str:
    """The motion by the silhouette, and how small a difference it would have shown."""
    if result["motion"] is None:
        return "Vectors do not show the finger: whether it moved as simulated is not tested."
    if wrong := _wrong(result, motion):
        return _listed(wrong)
    if result["motion"] == "agrees":
        return "The finger moves as simulated."
    if result["motion"] == "too uncertain":
        return f"Too uncertain to say: {_undecided(motion)}."
    differs = "; ".join(
        f"{q['label']} {size(q['simulation'], q['unit'])} against {size(q['data'], q['unit'])}"
        f"{part_of(q)}, which the registration knows to"
        f" ±{NBSP}{size(q['k'] * np.asarray(q['u_D']), q['unit'])}"
        for q in motion
        if q["differs"]
    )
    return (
        f"The recording's finger moves otherwise than the simulated one: {differs}. The inputs'"
        " uncertainty allows for it (u_input), so it is no fault of the model: correct"
        f" motion.strokes of the scene. {_motion_effect(flow)}"
    )


def _flow_answer(result: dict[str, Any], flow: list[Quantity]) -> str:
    """The flow by the quantities that could have shown a difference."""
    if wrong := _wrong(result, flow):
        return _listed(wrong)
    wide = _undecided(flow)
    if result["flow"] == "too uncertain":
        return f"A flow that errs by {result['too_uncertain']:.0%} would not be seen: {wide}."
    return f"The flow agrees. Nothing can be said of: {wide}." if wide else "The flow agrees."


def _listed(quantities: list[Quantity]) -> str:
    text = "; ".join(f"{q['label']}: {verdict_sentence(q)}" for q in quantities)
    return f"{text[0].upper()}{text[1:]}."


def _undecided(quantities: list[Quantity]) -> str:
    """Undecided quantities with the error that would be found, and the largest uncertainty."""
    wide = (q for q in quantities if q["verdict"] == "too uncertain")
    return ", ".join(
        f"{q['label']} (errors above {relative(q)} would be found, mostly {q['dominant']})"
        for q in wide
    )


def _incomplete(result: dict[str, Any]) -> str:
    """The runs that u_val lacks."""
    missing = result["missing_runs"]
    if not missing:
        return ""
    lacks = " and ".join(name for name in missing if name in ("grid", "time_step"))
    added = f", and S lacks what {lacks} would change" if lacks else ""
    text = f"Not in u_val, because these runs were not made: {', '.join(missing)}{added}"
    return f"{text}; differences are judged too strictly."


def _blame_of_motion(registration: dict[str, Any]) -> str:
    def more(name: str, up: str, down: str) -> str:
        value, band = registration[name], 196 * registration[f"{name}_std"]
        change = f"{100 * abs(value - 1):.1f}{NBSP}% {up if value >= 1 else down}"
        return f"{change} (±{NBSP}{band:.1f})"

    pressure = more("pressure_factor", "higher", "lower")
    return (
        "The motion is to blame: the recording's finger bends as if its pressure were"
        f" {pressure} than the simulation's, and takes {more('stretch', 'more', 'less')} time."
    )


def _blame_of_flow(result: dict[str, Any], wrong: list[Quantity]) -> str:
    """The cause of a flow that differs in the quantities `wrong`."""
    if result["motion"] is None:
        text = "The flow model is to blame, or a motion other than the simulated one."
    elif any(q["explained_by_motion"] is not None for q in wrong):
        names = ", ".join(q["label"] for q in wrong)
        text = f"At the recording's own motion the flow differs ({names}): the flow model is to"
        text += " blame."
    elif result["motion"] == "agrees":
        text = "The finger moves as simulated, so the flow model is to blame, not the motion."
    else:
        return "Whether motion or flow model is to blame is not known. " + UNKNOWN_EFFECT
    return text


def _motion_effect(flow: list[Quantity]) -> str:
    """Effect of the motion's difference on the flow, by the runs of pressure and duration."""
    explained = [q for q in flow if q["explained_by_motion"] is not None]
    parts = ", ".join(f"{q['label']} {_share(q)}" for q in explained)
    if not parts:
        return UNKNOWN_EFFECT
    return (
        "By the runs of pressure and duration that motion makes this part of the flow's"
        f" differences, as PIV shows them, which is taken out: {parts}."
    )


def _share(q: Quantity) -> str:
    """The motion's part in per cent of the quantity; a length for a place."""
    values = np.atleast_1d(np.asarray(q["explained_by_motion"], float))
    if values.size > 1:
        return size(values, q["unit"])
    return f"{100 * values[0] / abs(q['scale']):+.0f}{NBSP}%"
