"""The ledger: docs/verification.md and its figures, made from the results files in docs/verification/."""

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
    "plate_medium_layer", "plate_thin_layer",
    "plate_accelerating", "deforming_mesh", "exact_fields", "finger_2d", "finger",
)  # fmt: skip
HEAD = """# Verification and validation

`make validate` runs the flows of `cases/validation/` through the project's own stages (kinematics, mesh and morph, case, run,
sheet), as the studies `cases/validation/studies/*.csv` say ([cluster.md](cluster.md)), measures, and writes this page and `docs/verification/*.json`; what was solved for the same numbers is not solved
again. Every row: quantity, reference, result, tolerance and why. A row that is **missed** stays here as such.
"""


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


def page(results: list[dict[str, Any]], figures: set[str]) -> str:
    """The page in Markdown; `figures` are the names that have one."""
    checks = [check for result in results for check in result["checks"]]
    missed = [check for check in checks if not check["met"]]
    text = HEAD + f"\n{len(checks)} checks, {len(checks) - len(missed)} met, {len(missed)} missed."
    text += (
        "".join(f"\n- missed: {c['quantity']} (`{c['id']}`): {tolerated(c)}" for c in missed) + "\n"
    )
    for result in results:
        text += f"\n## {result['title']}\n\n{result['text']}\n\n"
        text += "| quantity | reference | result | deviation | tolerance | why | |\n|---|---|---|---|---|---|---|\n"
        text += "".join(row(check) for check in result["checks"])
        sources = sorted({c["source"] for c in result["checks"] if c["source"]})
        text += f"\nReference: {'; '.join(sources)}. " if sources else "\n"
        text += f"{origin(result)}\n"
        text += "".join(f"\n- {remark}" for remark in result["remarks"]) + (
            "\n" if result["remarks"] else ""
        )
        if result["name"] in figures:
            text += f"\n![{result['title']}](verification/{result['name']}.svg)\n"
    return text


def row(check: dict[str, Any]) -> str:
    """One line of a table."""
    unit = "" if check["unit"] == "1" else f" {check['unit']}"
    reference = "" if check["reference"] is None else f"{check['reference']:.4g}{unit}"
    how, deviation = check["how"], ""
    if how == "relative":
        deviation = f"{check['deviation']:+.2%}"
    elif how == "absolute":
        deviation = f"{check['deviation']:+.3g}"
    verdict = "met" if check["met"] else "**missed**"
    return (
        f"| {check['quantity']} | {reference} | {check['result']:.4g}{unit} | {deviation} | {tolerance(check)} |"
        f" {check['why']} | {verdict} |\n"
    )


def tolerance(check: dict[str, Any]) -> str:
    """The tolerance in words."""
    value, how = check["tolerance"], check["how"]
    unit = "" if check["unit"] == "1" else f" {check['unit']}"
    words = {"relative": f"± {value:.3g}".replace("± ", "± "), "absolute": f"± {value:.3g}{unit}"}
    if how == "relative":
        return f"± {value:.2%}".replace(".00%", " %").replace("%", " %").replace("  ", " ")
    return words.get(how, f"{'≤' if how == 'at most' else '≥'} {value:.3g}{unit}")


def tolerated(check: dict[str, Any]) -> str:
    """Result against reference and tolerance, in one phrase."""
    reference = "" if check["reference"] is None else f"{check['reference']:.4g} "
    return f"{check['result']:.4g}, wanted {reference}{tolerance(check)}"


def origin(result: dict[str, Any]) -> str:
    """Date, versions and cost."""
    versions, made = result["versions"], result["provenance"]
    parts = [f"Measured {result['date']}"]
    if "OpenFOAM" in versions:
        parts.append(f"OpenFOAM {versions['OpenFOAM']}")
    parts.append(f"numpy {versions['numpy']}, scipy {versions['scipy']}")
    for key, words in (
        ("cells", "{} cells"),
        ("steps", "{} steps"),
        ("cpu_seconds", "{} s of CPU time"),
        ("scene_hash", "scene {}"),
    ):
        if key in made:
            parts.append(words.format(made[key]))
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
    write_text(docs / "verification.md", page(results, drawn))
    return sum(not check["met"] for result in results for check in result["checks"])
