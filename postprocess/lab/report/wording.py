"""The verdict in words, for someone who knows the experiment and not the code."""

from __future__ import annotations

from typing import Any

import numpy as np

NBSP = "\u00a0"
UNITS = {
    "m²/s": (1e4, "cm²/s"),
    "m": (1e3, "mm"),
    "m/s": (1e3, "mm/s"),
    "rad": (180 / np.pi, "°"),
    "s": (1e3, "ms"),
}
BLAME = {
    "numerical": "mesh or time step",
    "input": "the inputs (pressure, time, geometry, material)",
    "data": "the measurement",
}
MOTION = ("final_bend", "duration")


def size(values: Any, unit: str) -> str:
    """Length of a vector, or a number with its sign, in the unit of a laboratory."""
    factor, name = UNITS[unit]
    values = np.atleast_1d(np.asarray(values, float))
    value = float(values[0]) if values.size == 1 else float(np.hypot(*values))
    return f"{value * factor:.3g}{NBSP}{name}"


def pair(values: Any, unit: str) -> str:
    """One number, or the two coordinates of a place."""
    factor, name = UNITS[unit]
    values = np.atleast_1d(np.asarray(values, float)) * factor
    number = f"({values[0]:.2f}, {values[1]:.2f})" if values.size == 2 else f"{values[0]:.4g}"
    return f"{number}{NBSP}{name}"


def verdict_sentence(q: dict[str, Any]) -> str:
    """One quantity's verdict in a sentence."""
    band = size(q["k"] * np.asarray(q["u_val"]), q["unit"])
    if q["verdict"] == "agrees":
        return f"agrees within ±{NBSP}{band}"
    if q["verdict"] == "model error":
        what = "the motion differs by" if q["name"] in MOTION else "model error of"
        return f"{what} about {size(q['error'], q['unit'])}{_part(q)}, known to ±{NBSP}{band}"
    return f"too uncertain to say: the band is ±{NBSP}{band}, mostly from {q['dominant']}"


def _part(q: dict[str, Any]) -> str:
    """The difference in per cent of what it is measured by."""
    return f" ({np.linalg.norm(q['error']) / abs(q['scale']):.0%})" if q["scale"] else ""


def answer(result: dict[str, Any]) -> str:
    """The page's first sentences: yes, no, or not to be said; what it rests on; what is to blame."""
    by_name = {q["name"]: q for q in result["quantities"]}
    if result["verdict"] == "agrees":
        q = by_name["circulation"]
        opening = (
            f"Yes: the simulation agrees with the laboratory's data within what is known of both. The {q['label']} is"
            f" {size(q['simulation'], q['unit'])} against {size(q['data'], q['unit'])}, with a band of"
            f" ±{NBSP}{size(q['k'] * np.asarray(q['u_val']), q['unit'])}."
        )
        parts = [opening, by_chance(result), motion_basis(result), undecided(result)]
    elif result["verdict"] == "too uncertain":
        opening = "It cannot be said: for most quantities the band of uncertainty is too wide for a verdict."
        parts = [opening, undecided(result), motion_basis(result)]
    else:
        wrong = "; ".join(f"{by_name[n]['label']}: {verdict_sentence(by_name[n])}" for n in result["wrong"])
        parts = [f"No: {wrong}.", basis(result), blame(result), motion_basis(result)]
    return " ".join(part for part in [*parts, incomplete(result)] if part)


def basis(result: dict[str, Any]) -> str:
    """Whether the verdict comes from the finger's silhouette or from the flow."""
    moves = [n for n in result["wrong"] if n in MOTION]
    if not moves or len(moves) < len(result["wrong"]):
        return ""
    rests = "This verdict rests on the finger's silhouette, not on the flow: no quantity of the flow differs by more than its band."
    return " ".join(part for part in (rests, by_chance(result), undecided(result)) if part)


def by_chance(result: dict[str, Any]) -> str:
    """Quantities beyond their own limit of 95 %, but within that at which all hold together."""
    judged = result["quantities"]
    wrong = [q for q in judged if q["verdict"] == "model error"]
    alone = ", ".join(q["label"] for q in wrong if q["name"] not in result["wrong"])
    by_itself = (
        f"Beyond its own limit of 95{NBSP}%: {alone}; among {len(judged)} quantities that may be chance."
    )
    return by_itself if alone else ""


def undecided(result: dict[str, Any]) -> str:
    """Quantities of which nothing can be said, and why."""
    uncertain = [q for q in result["quantities"] if q["verdict"] == "too uncertain"]
    listed = ", ".join(f"{q['label']} (mostly {q['dominant']})" for q in uncertain)
    return f"Too uncertain to say: {listed}." if uncertain else ""


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
    return f"Not in u_val, because these runs were not made: {', '.join(missing)}; differences are judged too strictly."


def blame(result: dict[str, Any]) -> str:
    """Is mesh, motion, PIV or physics to blame? What the quantities together say."""
    registration = result["registration"]
    moves = [n for n in result["wrong"] if n in MOTION]
    flow = [q for q in result["quantities"] if q["name"] not in MOTION]
    text = []
    if moves:
        factor, stretch = registration["pressure_factor"], registration["stretch"]
        text.append(
            f"The motion is to blame: the recording's finger bends as if its pressure were {_more(factor, 'higher', 'lower')}"
            f" (±{NBSP}{100 * 1.96 * registration['pressure_factor_std']:.1f}) than the simulation's, and takes"
            f" {_more(stretch, 'more', 'less')} (±{NBSP}{100 * 1.96 * registration['stretch_std']:.1f}) time."
        )
    explained = [q for q in flow if q["explained_by_motion"] is not None]
    rest = [q for q in explained if _beyond_motion(q)]
    wrong_flow = [q for q in flow if q["name"] in result["wrong"]]
    if moves and not explained:
        text.append(
            "Whether what the flow differs by follows from that motion is not known without the runs pressure and duration;"
            " drive the simulation with the measured motion (make compare-measured)."
        )
    elif moves and not rest:
        text.append(
            "What the flow differs by follows from that motion within u_val: drive the simulation with the measured one"
            " (make compare-measured)."
        )
    elif moves:
        labels = ", ".join(q["label"] for q in rest)
        text.append(f"Beyond the motion the flow differs ({labels}): physics, or what the model leaves out.")
    elif wrong_flow and any(q["name"] in MOTION for q in result["quantities"]):
        text.append("The finger moves as simulated, so the flow model is to blame, not the motion.")
    elif wrong_flow and result["measured_motion"]:
        text.append("The motion is the recording's, so the flow model is to blame.")
    elif wrong_flow:
        text.append("The flow model is to blame, or a motion other than the simulated one.")
    return " ".join(text)


def _more(factor: float, more: str, less: str) -> str:
    """A factor as per cent more or less."""
    return f"{100 * abs(factor - 1):.1f}{NBSP}% {more if factor >= 1 else less}"


def _beyond_motion(q: dict[str, Any]) -> bool:
    rest = np.asarray(q["error"]) - np.asarray(q["explained_by_motion"])
    return float(np.sqrt(np.sum((rest / np.asarray(q["u_val"])) ** 2))) > q["k"]


def rows(result: dict[str, Any]) -> list[dict[str, Any]]:
    """The table of verdicts as text."""
    out = []
    for q in result["quantities"]:
        unit = q["unit"]
        shown = lambda name, q=q: "–" if q[name] is None else pair(q[name], q["unit"])  # noqa: E731
        source = next(s for s in q["sources"] if s["name"] == q["dominant"])
        out.append(
            {
                "label": q["label"],
                **{name: shown(name) for name in ("simulation", "direct", "data", "error")},
                "measurement": shown("measurement_part"),
                "explained": shown("explained_by_motion"),
                **{name: size(q[name], unit) for name in ("u_num", "u_input", "u_D", "u_val")},
                "significance": f"{q['significance']:.2f}",
                "k": f"{q['k']:.2f}",
                "verdict": q["verdict"],
                "sentence": verdict_sentence(q),
                "dominant": f"{q['dominant']} ({BLAME[source['kind']]})",
                "sources": [(s["name"], s["kind"], size(s["std"], unit), s["how"]) for s in q["sources"]],
            }
        )
    return out


def tiles(result: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Key numbers of the first screen."""
    r = result["registration"]
    out = []
    for q in result["quantities"]:
        if q["name"] in ("final_bend", "circulation", "centre", "velocity_field"):
            remark = f"{q['verdict']}; u_val {size(q['u_val'], q['unit'])}, mostly {q['dominant']}"
            out.append((size(q["error"], q["unit"]), f"E of the {q['label']}", remark))
    delay = f"± {1.96 * r['delay_std_ms']:.1f} ms"
    out.append((f"{r['delay_ms']:.1f}{NBSP}ms", "delay of the recording's clock", delay))
    out.append(
        (f"{r['scale_m_per_px'] * 1e3:.4f}", "scale, mm/px", f"± {1.96 * r['scale_std_percent']:.2f} %")
    )
    return out
