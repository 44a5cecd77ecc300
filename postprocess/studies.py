"""Studies of a scene: what each of its levels changes, and what that does to the paper's findings; a table, a figure, a page.

Command: python -m postprocess.studies cases/pinch_studies --docs docs
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from pathlib import Path
from typing import Any

import pandas as pd

from postprocess import draw_studies
from postprocess.compare import judge
from postprocess.findings import read_findings
from postprocess.loading import load_evidence, read_clock
from postprocess.pinch_summary import pinch_summary
from postprocess.quantities import QUANTITIES
from postprocess.stagefiles import StageFiles, read_json, write_text
from postprocess.style import save
from postprocess.wording import quantity

COLUMNS = ["level", "change", "model", "cells", "kind", "quantity", "value", "unit", "met"]
NUMBERS = {
    "contact_time": "s",
    "circulation_at_contact": "m²/s",
    "jet_peak": "m/s",
    "jet_peak_after_contact": "m/s",
    "rise_peak": "m/s",
    "pressure_gap_peak": "Pa",
    "pressure_tip_max_peak": "Pa",
    "pressure_tip_min_peak": "Pa",
    "along_tip_approach": "m",
    "across_tip_approach": "m",
    "along_tip_after": "m",
    "across_tip_after": "m",
}
FREE = (
    "pinch.",
    "sheet.",
    "camera.",
)  # changes of these keys leave the finger's own motion as the single finger's


def study_levels(case: Path) -> dict[str, tuple[str, str]]:
    """By level of the scene's own file: the level at the root of its chain, and what it changes; the roots first, "as it is"."""
    path = case / "scene.toml"
    levels = tomllib.loads(path.read_text(encoding="utf-8")).get("levels", {})
    if not levels:
        raise ValueError(f"{path}: no [levels.…], so there is nothing to study")
    found: dict[str, tuple[str, str]] = {}
    for name in levels:
        root = name
        changes: list[str] = []
        while root in levels:
            own = dict(levels[root])
            parent = own.pop("extends", None)
            changes = [*flat(own), *changes]
            if parent is None:
                raise ValueError(f"{path}: levels.{root}: a study's level extends another; add extends")
            root = parent
        found.setdefault(root, (root, "as it is"))
        found[name] = (root, "; ".join(changes))
    return dict(sorted(found.items(), key=lambda item: (item[0] != item[1][0],)))


def flat(table: dict[str, Any], before: str = "") -> list[str]:
    """`key.key = value` of every number of nested tables."""
    lines = []
    for key, value in table.items():
        if isinstance(value, dict):
            lines += flat(value, f"{before}{key}.")
        else:
            lines.append(f"{before}{key} = {_plain(value)}")
    return lines


def _plain(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(_plain(item) for item in value)
    if isinstance(value, dict):
        return " ".join(f"{key} {item:g}" for key, item in value.items())
    return f"{value:g}" if isinstance(value, float) else str(value)


def findings_path(case: Path) -> Path:
    """The findings of a scene, or of the nearest scene that it extends that has some."""
    path = case / "reference" / "findings.toml"
    if path.exists():
        return path
    table = tomllib.loads((case / "scene.toml").read_text(encoding="utf-8"))
    if "extends" not in table:
        raise FileNotFoundError(f"{path} is missing; a scene needs its findings to be judged by")
    return findings_path(case / table["extends"])


def measure(case: Path, level: str, root: str, change: str) -> list[dict[str, Any]]:
    """Rows of `COLUMNS` of one level: the paper's findings by the CFD, and key numbers."""
    files = StageFiles(case, level)
    comparable = all(part.startswith(FREE) for part in change.split("; ")) or change == "as it is"
    evidence = load_evidence(files, root if comparable else level)
    clock = read_clock(files, evidence.planes["cfd"])
    run = read_json(files.required("run/run.json", "run"))
    about = {"level": level, "change": change, "model": run["model"], "cells": run["cells"]}
    rows: list[dict[str, Any]] = []
    for finding in read_findings(findings_path(case), frozenset(QUANTITIES)):
        if finding.kind == "paper" and "cfd" in finding.of:
            check = judge(finding, evidence, clock)
            value, met = check["measured"]["cfd"], check["met_by"].get("cfd")
            if value is None and not any("was not run" in note for note in check["notes"]):
                met = False
            rows.append(
                about
                | {
                    "kind": "finding",
                    "quantity": finding.id,
                    "value": value,
                    "unit": check["unit"],
                    "met": met,
                }
            )
    numbers = pinch_summary(evidence, clock)
    numbers |= numbers["cfd"]
    for name, unit in NUMBERS.items():
        rows.append(
            about
            | {"kind": "number", "quantity": name, "value": numbers.get(name), "unit": unit, "met": None}
        )
    for plane in evidence.planes.values():
        plane.close()
    return rows


def page(case: Path, table: pd.DataFrame, missing: list[str]) -> str:
    """The page as Markdown: the scene's own words, then what was measured."""
    words = case / "README.md"
    text = words.read_text(encoding="utf-8").strip() if words.exists() else f"# {case.name}"
    parts = [
        text,
        "Written by `make pinch-studies`; every number is in [pinch_studies.csv](pinch_studies.csv).",
        "![Key numbers of every study](pinch_studies.svg)",
    ]
    if missing:
        parts.append(f"Not run yet: {', '.join(missing)}.")
    for kind, heading in (("finding", "The paper's findings, by the CFD"), ("number", "Key numbers")):
        part = table[table["kind"] == kind]
        names = list(dict.fromkeys(part["quantity"]))
        lines = [f"## {heading}", "", f"| level | change | model | {' | '.join(names)} |"]
        lines.append("|---" * (3 + len(names)) + "|")
        for level, rows in part.groupby("level", sort=False):
            cells = {row.quantity: _cell(row) for row in rows.itertuples()}
            first = rows.iloc[0]
            shown = " | ".join(cells.get(name, "") for name in names)
            lines.append(f"| {level} | {first['change']} | {first['model']} | {shown} |")
        parts.append("\n".join(lines))
    return "\n\n".join(parts) + "\n"


def _cell(row: Any) -> str:
    value = row.value
    if value is None or (isinstance(value, float) and pd.isna(value)):
        return "–" if row.met is None or pd.isna(row.met) else "not there: **no**"
    text = f"{value * 1e4:.0f} cm²/s" if row.unit == "m²/s" else quantity(value, row.unit)
    if row.kind == "finding" and row.met is not None:
        text += "" if row.met else " **no**"
    return text


def gather(case: Path) -> tuple[pd.DataFrame, list[str]]:
    """Rows of every level that was run, and the names of those that were not."""
    rows, missing = [], []
    for level, (root, change) in study_levels(case).items():
        if StageFiles(case, level).optional("vortices_cfd.csv") is None:
            missing.append(level)
        else:
            rows += measure(case, level, root, change)
    if not rows:
        raise FileNotFoundError(f"{case / 'out'}: no level was run; make pinch-studies")
    return pd.DataFrame(rows, columns=COLUMNS), missing


def main(argv: list[str] | None = None) -> int:
    """Command line; returns 0 good, 2 bad input."""
    parser = argparse.ArgumentParser(prog="python -m postprocess.studies", description=__doc__)
    parser.add_argument("case", type=Path, help="folder of the studies, such as cases/pinch_studies")
    parser.add_argument("--docs", type=Path, default=Path("docs"))
    args = parser.parse_args(argv)
    try:
        table, missing = gather(args.case)
    except (ValueError, OSError) as error:
        print(f"studies: {error}", file=sys.stderr)
        return 2
    name = args.docs / args.case.resolve().name
    write_text(name.with_suffix(".csv"), table.to_csv(index=False))
    save(draw_studies.bars(table), name.with_suffix(".svg"))
    write_text(name.with_suffix(".md"), page(args.case, table, missing))
    return 0


if __name__ == "__main__":
    sys.exit(main())
