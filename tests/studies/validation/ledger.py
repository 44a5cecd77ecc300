"""The ledger: docs/verification.md and its figures, from the files in docs/verification/."""

import json
from pathlib import Path
from typing import Any

from fileio.atomic import write_text
from fileio.errors import StageError
from tests.studies.pages import write_table
from tests.studies.validation.checks import FORMAT
from tests.studies.validation.figures import FIGURES

DOCS = Path(__file__).resolve().parents[3] / "docs"
ORDER = (
    "oscillating_cylinder", "impulsive_cylinder", "accelerating_cylinder", "sprung_cylinder",
    "cantilever_plate", "plate_impulsive",
    "plate_medium_layer", "plate_thin_layer", "plate_accelerating", "plate_rotating",
    "deforming_mesh", "exact_fields", "finger_2d", "finger",
)  # fmt: skip
COLUMNS = ("flow", "check", "quantity", "reference", "result", "deviation", "tolerance", "met",
           "why", "source", "date")  # fmt: skip


def read_results(folder: Path) -> list[dict[str, Any]]:
    """Results files in the ledger's order. Raises StageError where one is damaged."""
    results = {}
    for path in sorted(folder.glob("*.json")):
        try:
            result = json.loads(path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise StageError(
                f"{path}: not valid JSON ({error}); delete it and run make validate"
            ) from None
        if result.get("format") != FORMAT:
            raise StageError(
                f"{path}: format is {result.get('format')!r}, expected {FORMAT!r}; delete it"
            )
        results[result["name"]] = result
    known = [results.pop(name) for name in ORDER if name in results]
    return known + list(results.values())


def _page(results: list[dict[str, Any]], figures: set[str]) -> str:
    """The page in Markdown; `figures` are the names that have one."""
    checks = [check for result in results for check in result["checks"]]
    missed = [check for check in checks if not check["met"]]
    text = (Path(__file__).parent / "ledger_head.md").read_text(encoding="utf-8")
    text += f"\n{len(checks)} checks: {len(checks) - len(missed)} met, {len(missed)} missed.\n"
    text += "\n| flow | checks met | measured | reference |\n|---|---|---|---|\n"
    for result in results:
        met = sum(check["met"] for check in result["checks"])
        sources = sorted({c["source"] for c in result["checks"] if c["source"]})
        cells = (result["title"], f"{met} of {len(result['checks'])}", result["date"])
        text += f"| {' | '.join(cells)} | {'; '.join(sources)} |\n"
    text += "\n## Missed\n\n| quantity | result | tolerance |\n|---|---|---|\n"
    for check in missed:
        row = _row(check)
        text += f"| {row['quantity']} | {row['result']} | {row['reference']} {row['tolerance']} |\n"
    text += "\n## Figures\n"
    for result in results:
        if result["name"] in figures:
            title, name = result["title"], result["name"]
            text += f"\n**{title}**\n\n![{title}](verification/{name}.svg)\n"
    return text


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


def write_ledger(docs: Path = DOCS) -> int:
    """Write page, table and figures; returns the number of missed checks."""
    folder = docs / "verification"
    results = read_results(folder)
    if not results:
        raise StageError(f"{folder}: no results; run make validate")
    drawn = set()
    for result in results:
        draw = FIGURES.get(result["name"])
        if draw and result["curves"]:
            draw(result["curves"], folder / f"{result['name']}.svg")
            drawn.add(result["name"])
    write_text(docs / "verification.md", _page(results, drawn))
    rows = [
        {"flow": result["name"], "date": result["date"]} | _row(check)
        for result in results
        for check in result["checks"]
    ]
    write_table(folder / "checks.csv", COLUMNS, rows)
    return sum(not check["met"] for result in results for check in result["checks"])
