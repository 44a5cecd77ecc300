"""The page's answers in words, for someone who knows the experiment and not the code: the motion's, the flow's, what is to blame."""

from __future__ import annotations

from typing import Any

import numpy as np

from postprocess.lab.judgement.compare import MOTION
from postprocess.lab.report.wording import part_of, relative, verdict_sentence
from postprocess.words import NBSP, size

WORDS = {
    "agrees": "yes",
    "model error": "no",
    "too uncertain": "cannot be said",
    "differs within the inputs": "no, but within what is known of the inputs",
}


def answer(result: dict[str, Any]) -> str:
    """The page's first sentences: an answer for the motion and one for the flow, what each rests on, what is to blame."""
    motion = "not tested" if result["motion"] is None else WORDS[result["motion"]]
    parts = [
        f"Motion: {motion}. Flow: {WORDS[result['flow']]}.",
        motion_answer(result),
        flow_answer(result),
    ]
    if result["verdict"] == "model error":
        parts += [blame(result)]
    return " ".join(part for part in [*parts, by_chance(result), incomplete(result)] if part)


def motion_answer(result: dict[str, Any]) -> str:
    """What the finger's silhouette says, and how small a difference it would have shown."""
    motion = [q for q in result["quantities"] if q["name"] in MOTION]
    if result["motion"] is None:
        return motion_basis(result)
    wrong = [q for q in motion if q["name"] in result["wrong"]]
    if wrong:
        return listed(wrong)
    if result["motion"] == "agrees":
        return f"The finger moves as simulated; {unseen(motion)}."
    if result["motion"] == "too uncertain":
        return undecided(motion)
    differs = "; ".join(
        f"{q['label']} {size(q['simulation'], q['unit'])} against {size(q['data'], q['unit'])}{part_of(q)}, which the registration"
        f" knows to ±{NBSP}{size(q['k'] * np.asarray(q['u_D']), q['unit'])}"
        for q in motion
        if q["differs"]
    )
    return (
        f"The recording's finger moves otherwise than the simulated one: {differs}. The inputs' uncertainty allows for it (u_input), so it"
        f" is no fault of the model: correct motion.strokes of the scene, or take the measured motion (make compare-measured)."
        f" {motion_effect(result)}"
    ).strip()


def flow_answer(result: dict[str, Any]) -> str:
    """What the flow's quantities say: only those that could have shown a difference are evidence."""
    flow = [q for q in result["quantities"] if q["name"] not in MOTION]
    wrong = [q for q in flow if q["name"] in result["wrong"]]
    if wrong:
        return listed(wrong)
    limit = f"{result['too_uncertain']:.0%}"
    if result["flow"] == "too uncertain":
        lone = [q for q in flow if q["joint_verdict"] == "agrees"]
        but = (
            f" The {', '.join(q['label'] for q in lone)} would have shown one, which is too little to go by."
            if lone
            else ""
        )
        return f"A flow that errs by {limit} would not be seen: {hidden(flow)}.{but}"
    sure = [q for q in flow if q["joint_verdict"] == "agrees"]
    values = "; ".join(
        f"{q['label']} {size(q['simulation'], q['unit'])} against {size(q['data'], q['unit'])}"
        for q in sure
        if q["name"] != "velocity_field"
    )
    text = f"The flow agrees{': ' + values if values else ''}; {unseen(sure)}."
    rest = [q for q in flow if q["joint_verdict"] == "too uncertain"]
    return f"{text} Nothing can be said of: {hidden(rest)}." if rest else text


def listed(quantities: list[dict[str, Any]]) -> str:
    """The verdicts of some quantities as a sentence."""
    text = "; ".join(f"{q['label']}: {verdict_sentence(q)}" for q in quantities)
    return f"{text[0].upper()}{text[1:]}."


def unseen(quantities: list[dict[str, Any]]) -> str:
    """How large an error of each quantity would still be missed."""
    limits = ", ".join(f"{q['label']} {relative(q)}" for q in quantities)
    return f"a smaller error than these may not be seen: {limits}"


def hidden(quantities: list[dict[str, Any]]) -> str:
    """Quantities with the error that could hide in them, and where the uncertainty comes from."""
    wide = [q for q in quantities if q["joint_verdict"] == "too uncertain"]
    return ", ".join(f"{q['label']} ({_found(q)})" for q in wide)


def _found(q: dict[str, Any]) -> str:
    """What error of a quantity would be found, and what stands before a smaller one."""
    if q["detectable"] is None:
        share = max(s["share"] for s in q["sources"])
        return f"no error for sure, however large: PIV takes {share:.0%} off the simulation's own"
    return f"only an error above {relative(q)}, mostly {q['dominant']}"


def undecided(quantities: list[dict[str, Any]]) -> str:
    """Quantities of which nothing can be said, and why; empty where there is none."""
    wide = hidden(quantities)
    return f"Too uncertain to say: {wide}." if wide else ""


def by_chance(result: dict[str, Any]) -> str:
    """Quantities beyond their own limit of 95 %, but within that at which all hold together."""
    judged = result["quantities"]
    wrong = [q for q in judged if q["verdict"] == "model error"]
    alone = ", ".join(q["label"] for q in wrong if q["name"] not in result["wrong"])
    by_itself = f"Beyond its own limit of 95{NBSP}%: {alone}; among {len(judged)} quantities that may be chance."
    return by_itself if alone else ""


def motion_basis(result: dict[str, Any]) -> str:
    """What is known of the finger's own motion, where it was not tested."""
    if result["measured_motion"]:
        return "The simulation is driven by this recording's own motion, which is therefore not tested."
    if not any(q["name"] in MOTION for q in result["quantities"]):
        return "Vectors do not show the finger: whether it moved as simulated is not tested."
    return ""


def incomplete(result: dict[str, Any]) -> str:
    """What u_val lacks."""
    missing = result["missing_runs"]
    if not missing:
        return ""
    lacks = [name for name in missing if name in NUMERICS]
    added = f", and S lacks what {' and '.join(lacks)} would change" if lacks else ""
    return f"Not in u_val, because these runs were not made: {', '.join(missing)}{added}; differences are judged too strictly."


def blame(result: dict[str, Any]) -> str:
    """What the quantities together say is to blame: the motion, and what it does to the flow; else the flow model, and which part."""
    registration = result["registration"]
    wrong = [
        q for q in result["quantities"] if q["name"] in result["wrong"] and q["name"] not in MOTION
    ]
    text = []
    if result["motion"] == "model error":
        factor, stretch = registration["pressure_factor"], registration["stretch"]
        text.append(
            f"The motion is to blame: the recording's finger bends as if its pressure were {_more(factor, 'higher', 'lower')}"
            f" (±{NBSP}{100 * 1.96 * registration['pressure_factor_std']:.1f}) than the simulation's, and takes"
            f" {_more(stretch, 'more', 'less')} (±{NBSP}{100 * 1.96 * registration['stretch_std']:.1f}) time."
        )
        text.append(motion_effect(result))
    if wrong:
        text.append(blame_of_flow(result, wrong))
    return " ".join(part for part in text if part)


def blame_of_flow(result: dict[str, Any], wrong: list[dict[str, Any]]) -> str:
    """What a flow that differs in the quantities `wrong` is due to, as far as its motion is known to be the recording's."""
    names = ", ".join(q["label"] for q in wrong)
    if result["measured_motion"]:
        text = "The motion is the recording's, so the flow model is to blame."
    elif result["motion"] is None:
        text = "The flow model is to blame, or a motion other than the simulated one."
    elif any(q["explained_by_motion"] is not None for q in wrong):
        text = (
            f"At the recording's own motion the flow differs ({names}): the flow model is to blame."
        )
    elif result["motion"] == "agrees":
        text = "The finger moves as simulated, so the flow model is to blame, not the motion."
    else:
        return (
            "Motion and flow model are not told apart; make compare-measured takes the motion out."
        )
    return f"{text} {separated(wrong, result)}"


def motion_effect(result: dict[str, Any]) -> str:
    """What the motion's difference does to the flow's quantities, as the runs of pressure and duration show it."""
    explained = [q for q in result["quantities"] if q["explained_by_motion"] is not None]
    if not explained:
        return (
            "What that does to the flow is not known without the runs pressure and duration; drive the simulation with the measured"
            " motion (make compare-measured)."
        )
    parts = ", ".join(f"{q['label']} {_share(q['explained_by_motion'], q)}" for q in explained)
    return f"By the runs of pressure and duration that motion makes this part of the flow's differences, as PIV shows them, which is taken out: {parts}."


def _share(values: Any, q: dict[str, Any]) -> str:
    """A difference in per cent of what the quantity is measured by; a length for a place."""
    values = np.atleast_1d(np.asarray(values, float))
    return (
        size(values, q["unit"])
        if values.size > 1
        else f"{100 * values[0] / abs(q['scale']):+.0f}{NBSP}%"
    )


NUMERICS = {"grid": "the mesh", "time_step": "the time step"}


def separated(wrong: list[dict[str, Any]], result: dict[str, Any]) -> str:
    """Which causes in the flow model the runs beside the nominal one rule out, and which nothing here tells apart."""
    out: list[str] = []
    open_: list[str] = []
    for name, what in NUMERICS.items():
        of = [next((s for s in q["sources"] if s["name"] == name), None) for q in wrong]
        known = [(q, s) for q, s in zip(wrong, of, strict=True) if s is not None]
        small = all(
            q["k"] * np.linalg.norm(s["std"]) < 0.5 * np.linalg.norm(q["error"]) for q, s in known
        )
        (out if known and small else open_).append(what)
    open_ += (
        ["the viscosity"]
        if not any(s["name"] == "viscosity" for q in wrong for s in q["sources"])
        else []
    )
    open_ += ["the two dimensions of this level"] if result["two_dimensional"] else []
    text = f"The runs rule out {' and '.join(out)} as the cause. " if out else ""
    return (
        f"{text}Not told apart by any run: {', '.join([*open_, 'what the equations leave out'])}."
    )


def _more(factor: float, more: str, less: str) -> str:
    """A factor as per cent more or less."""
    return f"{100 * abs(factor - 1):.1f}{NBSP}% {more if factor >= 1 else less}"
