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
    """The difference in per cent of what it is measured by."""
    return f" ({np.linalg.norm(q['error']) / abs(q['scale']):.0%})" if q["scale"] else ""


def relative(q: dict[str, Any]) -> str:
    """The smallest model error that the verdict finds with 95 %, in per cent of the quantity; a length for a place.

    It must be known: `detectable` is None where no error is found.
    """
    if np.size(q["error"]) > 1 or not q["scale"]:
        return size(q["detectable"], q["unit"])
    return f"{100 * q['detectable'] / abs(q['scale']):.0f}{NBSP}%"


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
                "finer": shown("finer"),
                **{name: size(q[name], unit) for name in ("u_num", "u_input", "u_D", "u_val")},
                "significance": f"{q['significance']:.2f}",
                "k": f"{q['k']:.2f}",
                "verdict": q["verdict"],
                "detectable": "none"
                if q["detectable"] is None
                else f"{size(q['detectable'], unit)} ({relative(q)})",
                "sentence": verdict_sentence(q),
                "dominant": f"{q['dominant']} ({BLAME[source['kind']]})",
                "sources": [
                    (s["name"], s["kind"], size(s["std"], unit), s["how"]) for s in q["sources"]
                ],
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
        (
            f"{r['scale_m_per_px'] * 1e3:.4f}",
            "scale, mm/px",
            f"± {1.96 * r['scale_std_percent']:.2f} %",
        )
    )
    return out
