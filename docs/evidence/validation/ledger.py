"""Tables and figures of docs/verification.md, from the results in docs/verification/."""

from pathlib import Path
from typing import Any

import pandas as pd

from docs.evidence.validation.figures import FIGURES
from piv.files.errors import StageError
from piv.files.json_text import parse_json
from postprocess.tables import write_table

FOLDER = Path(__file__).resolve().parents[3] / "docs" / "verification"
ORDER = (
    "oscillating_cylinder", "impulsive_cylinder", "accelerating_cylinder", "sprung_cylinder",
    "cylinder_in_current", "turek_hron", "turek_hron_flutter", "luhar_nepf",
    "cantilever_plate", "plate_impulsive",
    "plate_medium_layer", "plate_thin_layer", "plate_accelerating",
    "deforming_mesh", "finger_2d", "finger", "ringdown",
)  # fmt: skip


def _flow(result: dict[str, Any]) -> dict[str, str]:
    """One line of the table of flows."""
    checks = result["checks"]
    met = sum(check["met"] for check in checks)
    sources = sorted({check["source"] for check in checks if check["source"]})
    score = {"flow": result["title"], "checks met": f"{met} of {len(checks)}"}
    measured = f"{result['date']} {result.get('commit', '')}".strip()
    return score | {"measured": measured, "reference": "; ".join(sources)}


def _unit(check: dict[str, Any]) -> str:
    return "" if check["unit"] == "1" else f" {check['unit']}"


def _row(check: dict[str, Any]) -> dict[str, str]:
    """One line of the table of checks."""
    unit, gap = _unit(check), check["deviation"]
    return {
        "check": check["id"],
        "quantity": check["quantity"],
        "reference": "" if check["reference"] is None else f"{check['reference']:.4g}{unit}",
        "result": f"{check['result']:.4g}{unit}",
        "deviation": {"relative": f"{gap:+.2%}", "absolute": f"{gap:+.3g}"}.get(check["how"], ""),
        "tolerance": _tolerance(check),
        "met": "met" if check["met"] else "missed",
        "why": check["why"],
        "source": check["source"],
    }


def _tolerance(check: dict[str, Any]) -> str:
    """The tolerance in words."""
    value, how = check["tolerance"], check["how"]
    if how == "relative":
        return f"± {value:.2%}".replace(".00%", " %").replace("%", " %").replace("  ", " ")
    sign = {"absolute": "±", "at most": "≤", "at least": "≥"}[how]
    return f"{sign} {value:.3g}{_unit(check)}"


def write_ledger(folder: Path = FOLDER) -> int:
    """Write tables and figures; returns the number of missed checks."""
    files = [path for name in ORDER if (path := folder / f"{name}.json").exists()]
    if not files:
        raise StageError(f"{folder}: no results; run make validate")
    texts = {path: path.read_text(encoding="utf-8") for path in files}
    results = [parse_json(text, path, "run make validate") for path, text in texts.items()]
    for result in results:
        if result["curves"] and result["name"] in FIGURES:
            FIGURES[result["name"]](result["curves"], folder / f"{result['name']}.svg")
    rows = [
        {"flow": result["name"]} | _row(check) | {"date": result["date"]}
        for result in results
        for check in result["checks"]
    ]
    checks = pd.DataFrame(rows)
    missed = checks[checks["met"] == "missed"]
    wanted = (missed["reference"] + " " + missed["tolerance"]).str.strip()
    write_table(folder / "checks.csv", checks)
    write_table(folder / "flows.csv", pd.DataFrame(map(_flow, results)))
    write_table(folder / "missed.csv", missed[["quantity", "result"]].assign(tolerance=wanted))
    return len(missed)
