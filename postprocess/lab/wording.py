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
    return (
        f"({values[0]:.2f}, {values[1]:.2f}){NBSP}{name}"
        if values.size == 2
        else f"{values[0]:.4g}{NBSP}{name}"
    )


def verdict_sentence(q: dict[str, Any]) -> str:
    """One quantity's verdict in a sentence."""
    band = size(q["k"] * np.asarray(q["u_val"]), q["unit"])
    part = float(np.linalg.norm(q["error"])) / abs(q["scale"]) if q["scale"] else float("nan")
    if q["verdict"] == "agrees":
        return f"agrees within {band}"
    if q["verdict"] == "model error":
        return f"model error of about {size(q['error'], q['unit'])} ({part:.0%}), known to ±{NBSP}{band}"
    return f"too uncertain to say: the band is ±{NBSP}{band}"


def answer(result: dict[str, Any]) -> str:
    """The page's first sentence."""
    by_name = {q["name"]: q for q in result["quantities"]}
    if result["verdict"] == "agrees":
        band = by_name["circulation"]
        text = (
            "Yes: the simulation agrees with the recording within what is known of both; the tip vortex' circulation to"
            f" {size(band['error'], band['unit']).lstrip('-')} of {size(band['data'], band['unit']).lstrip('-')}, band ±{NBSP}{size(band['k'] * np.asarray(band['u_val']), band['unit'])}."
        )
        return text + _width(result)
    if result["verdict"] == "too uncertain":
        return (
            "It cannot be said: for most quantities the measurement or the simulation is too uncertain."
            + _width(result)
        )
    wrong = [by_name[name] for name in result["wrong"]]
    return "No: " + "; ".join(f"{q['label']}: {verdict_sentence(q)}" for q in wrong) + ". " + blame(result)


def _width(result: dict[str, Any]) -> str:
    unsaid = [q["label"] for q in result["quantities"] if q["verdict"] == "too uncertain"]
    return f" Too uncertain to say: {', '.join(unsaid)}." if unsaid else ""


def blame(result: dict[str, Any]) -> str:
    """Is mesh, motion, PIV or physics to blame? What the quantities together say."""
    registration = result["registration"]
    moves = [n for n in result["wrong"] if n in ("final_bend", "duration")]
    flow = [q for q in result["quantities"] if q["name"] not in ("final_bend", "duration")]
    text = []
    if moves:
        factor, stretch = registration["pressure_factor"], registration["stretch"]
        text.append(
            f"The motion is to blame: the recording's finger bends as if its pressure were {100 * (factor - 1):+.1f}{NBSP}%"
            f" (± {100 * 1.96 * registration['pressure_factor_std']:.1f}) and takes {100 * (stretch - 1):+.1f}{NBSP}%"
            f" (± {100 * 1.96 * registration['stretch_std']:.1f}) of time beside the simulation's."
        )
    rest = [q for q in flow if q["explained_by_motion"] is not None and _beyond_motion(q)]
    wrong_flow = [q for q in flow if q["name"] in result["wrong"]]
    if moves and not rest:
        text.append(
            "What the flow differs by follows from that motion within u_val: drive the simulation with the measured one."
        )
    elif rest:
        text.append(
            "Beyond the motion the flow itself differs ("
            + ", ".join(q["label"] for q in rest)
            + "): physics or what the model leaves out."
        )
    elif wrong_flow and not moves:
        text.append("The finger moves as simulated, so the flow model is to blame, not the motion.")
    return " ".join(text)


def _beyond_motion(q: dict[str, Any]) -> bool:
    rest = np.asarray(q["error"]) - np.asarray(q["explained_by_motion"])
    return float(np.sqrt(np.sum((rest / np.asarray(q["u_val"])) ** 2))) > q["k"]


def rows(result: dict[str, Any]) -> list[dict[str, Any]]:
    """The table of verdicts as text."""
    out = []
    for q in result["quantities"]:
        unit = q["unit"]
        parts = {name: size(np.asarray(q[name]), unit) for name in ("u_num", "u_input", "u_D", "u_val")}
        explained, measured = q["explained_by_motion"], q["measurement_part"]
        source = next(s for s in q["sources"] if s["name"] == q["dominant"])
        out.append(
            {
                "label": q["label"],
                "simulation": pair(q["simulation"], unit),
                "direct": pair(q["direct"], unit),
                "data": pair(q["data"], unit),
                "error": pair(q["error"], unit),
                "measurement": "–" if measured is None else pair(measured, unit),
                "explained": "–" if explained is None else pair(explained, unit),
                **parts,
                "significance": f"{q['significance']:.2f}",
                "k": f"{q['k']:.2f}",
                "verdict": q["verdict"],
                "sentence": verdict_sentence(q),
                "dominant": f"{q['dominant']} ({BLAME[source['kind']]})",
                "sources": [
                    (s["name"], s["kind"], size(np.asarray(s["std"]), unit), s["how"]) for s in q["sources"]
                ],
            }
        )
    return out


def tiles(result: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Key numbers of the first screen."""
    r = result["registration"]
    found = [
        (q["label"], q)
        for q in result["quantities"]
        if q["name"] in ("final_bend", "circulation", "centre", "velocity_field")
    ]
    out = [
        (
            size(q["error"], q["unit"]),
            f"E of the {label}",
            f"{q['verdict']}; u_val {size(q['u_val'], q['unit'])}, mostly {q['dominant']}",
        )
        for label, q in found
    ]
    out.append(
        (
            f"{r['delay_ms']:.1f}{NBSP}ms",
            "delay of the recording's clock",
            f"± {1.96 * r['delay_std_ms']:.1f} ms",
        )
    )
    out.append((f"{r['scale_mm_per_px']:.4f}", "scale, mm/px", f"± {1.96 * r['scale_std_percent']:.2f} %"))
    return out
