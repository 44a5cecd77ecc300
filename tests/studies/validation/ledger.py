"""The ledger: docs/verification.md and its figures, from the files in docs/verification/."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from fileio.atomic import write_text
from fileio.errors import StageError
from tests.studies.validation.checks import FORMAT
from tests.studies.validation.figures import FIGURES

DOCS = Path(__file__).resolve().parents[3] / "docs"
ORDER = (
    "oscillating_cylinder", "impulsive_cylinder", "accelerating_cylinder", "plate_impulsive",
    "plate_medium_layer", "plate_thin_layer", "plate_accelerating", "deforming_mesh",
    "exact_fields", "finger_2d", "finger",
)  # fmt: skip
TABLE = "| quantity | reference | result | deviation | tolerance | why | |\n" + 7 * "|---" + "|\n"
COSTS = {"cells": "{} cells", "steps": "{} steps", "cpu_seconds": "{} s of CPU time"}


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
    text += f"\n{len(checks)} checks, {len(checks) - len(missed)} met, {len(missed)} missed."
    for check in missed:
        reference = "" if check["reference"] is None else f"{check['reference']:.4g} "
        wanted = f"{check['result']:.4g}, wanted {reference}{_tolerance(check)}"
        text += f"\n- missed: {check['quantity']} (`{check['id']}`): {wanted}"
    text += "\n"
    for result in results:
        text += f"\n## {result['title']}\n\n{result['text']}\n\n{TABLE}"
        text += "".join(_row(check) for check in result["checks"])
        sources = sorted({c["source"] for c in result["checks"] if c["source"]})
        text += f"\nReference: {'; '.join(sources)}. " if sources else "\n"
        text += f"{_origin(result)}\n"
        if result["remarks"]:
            text += "".join(f"\n- {remark}" for remark in result["remarks"]) + "\n"
        if result["name"] in figures:
            text += f"\n![{result['title']}](verification/{result['name']}.svg)\n"
    return text


def _unit(check: dict[str, Any]) -> str:
    return "" if check["unit"] == "1" else f" {check['unit']}"


def _row(check: dict[str, Any]) -> str:
    """One line of a table."""
    unit, gap = _unit(check), check["deviation"]
    reference = "" if check["reference"] is None else f"{check['reference']:.4g}{unit}"
    deviation = {"relative": f"{gap:+.2%}", "absolute": f"{gap:+.3g}"}.get(check["how"], "")
    result = f"{check['result']:.4g}{unit}"
    cells = (check["quantity"], reference, result, deviation, _tolerance(check), check["why"])
    return f"| {' | '.join(cells)} | {'met' if check['met'] else '**missed**'} |\n"


def _tolerance(check: dict[str, Any]) -> str:
    """The tolerance in words."""
    value, how = check["tolerance"], check["how"]
    if how == "relative":
        return f"± {value:.2%}".replace(".00%", " %").replace("%", " %").replace("  ", " ")
    sign = {"absolute": "±", "at most": "≤", "at least": "≥"}[how]
    return f"{sign} {value:.3g}{_unit(check)}"


def _origin(result: dict[str, Any]) -> str:
    """Date, versions and cost."""
    versions, made = result["versions"], result["provenance"]
    names = [name for name in ("OpenFOAM", "numpy", "scipy") if name in versions]
    parts = [f"Measured {result['date']}", *(f"{name} {versions[name]}" for name in names)]
    parts += [words.format(made[key]) for key, words in COSTS.items() if key in made]
    return ", ".join(parts) + "."


def write_ledger(docs: Path = DOCS) -> int:
    """Write the page and its figures; returns the number of missed checks."""
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
    return sum(not check["met"] for result in results for check in result["checks"])
