"""A study's runs judged by the findings of their scene: what each changes, and what that does; a table, a figure, a page.

Rows of the table that was written before stay where a run's results are gone but its settings and findings are the same.

Command: python -m postprocess judge cases/pinch/out/studies/variations/plan.json -o docs/pinch_studies (make pinch-studies)
"""

from __future__ import annotations

import argparse
import re
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd

from fileio.atomic import write_text
from fileio.formats.records import RUN
from fileio.provenance import digest
from postprocess.compare.findings import Finding, read_findings
from postprocess.compare.pinch_summary import pinch_summary
from postprocess.compare.quantities import QUANTITIES
from postprocess.compare.stage import judge
from postprocess.draw.quantity_text import quantity
from postprocess.draw.style import save
from postprocess.evidence.load import load_evidence
from postprocess.evidence.stage_files import extended_scenes
from postprocess.studies import bars as draw_studies
from postprocess.studies.state import files_of, missing_runs, missing_sentence
from postprocess.studies.table import read_plan

ROW = ["kind", "quantity", "value", "unit", "met", "note"]
COLUMNS = ["run", "change", "model", "cells", "steps", "made_with", "measured_on", "openfoam", *ROW]
NUMBERS = {
    "Ventral pair": {
        "contact_time": "s",
        "ventral_forms_gap": "m",
        "ventral_forms_before_contact": "s",
        "ventral_circulation_peak": "m²/s",
        "ventral_circulation_peak_time": "s",
        "ventral_part": "fraction",
        "ventral_rise_peak": "m/s",
        "ventral_circulation_after": "m²/s",
    },
    "Dorsal pair and half the plane": {
        "along_tip_approach": "m",
        "across_tip_approach": "m",
        "core_radii_from_plane_approach": "1",
        "dorsal_circulation_at_contact": "m²/s",
        "dorsal_circulation_after": "m²/s",
        "dorsal_y_after": "m",
        "half_circulation_after": "m²/s",
        "half_impulse_after": "m³/s",
    },
    "Jet, flow up and pressure": {
        "jet_speed_20mm_peak": "m/s",
        "jet_flux_20mm_peak": "m³/s²",
        "jet_speed_40mm_peak": "m/s",
        "jet_flux_40mm_peak": "m³/s²",
        "jet_peak": "m/s",
        "jet_peak_after_contact": "m/s",
        "rise_peak": "m/s",
        "pressure_gap_peak": "Pa",
        "pressure_tip_max_peak": "Pa",
        "pressure_tip_min_peak": "Pa",
    },
}
# changes of these keys leave the finger's own motion as the single finger's
FREE = ("pinch.", "sheet.", "camera.")
AS_IT_IS = "as it is"
# what of a finding decides, without its words
JUDGING = ("id", "quantity", "comparison", "value", "window", "tolerance", "finger")


def changes(runs: list[dict[str, Any]]) -> dict[str, str]:
    """By run what sets it apart: its overrides, but for those that all runs of the plan have in common."""
    common = [
        item
        for item in runs[0]["overrides"].items()
        if all(item in run["overrides"].items() for run in runs)
    ]
    return {
        run["run"]: "; ".join(
            f"{key} = {_plain(value)}"
            for key, value in run["overrides"].items()
            if (key, value) not in common
        )
        or AS_IT_IS
        for run in runs
    }


def _plain(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(_plain(item) for item in value)
    if isinstance(value, dict):
        return " ".join(f"{key} {item:g}" for key, item in value.items())
    return f"{value:g}" if isinstance(value, int | float) else str(value)


def findings_path(scene: Path) -> Path:
    """The findings of a scene, or of the nearest scene that it extends that has some."""
    paths = [folder / "reference" / "findings.toml" for folder in extended_scenes(scene)]
    path = next((path for path in paths if path.exists()), None)
    if path is None:
        raise FileNotFoundError(f"{paths[0]} is missing; a study is judged by its scene's findings")
    return path


def findings_of(run: dict[str, Any]) -> list[Finding]:
    """What a run of a plan is judged by: the paper's findings that the CFD can show."""
    found = read_findings(findings_path(Path(run["folder"])), frozenset(QUANTITIES))
    return [finding for finding in found if finding.kind == "paper" and "cfd" in finding.of]


def made_with(run: dict[str, Any]) -> str:
    """Digest of all that a run's rows follow from: the settings of its stages, the files that these name, and its findings."""
    asked = [{key: asdict(finding)[key] for key in JUDGING} for finding in findings_of(run)]
    return digest([run["settings"], asked])


def measure(run: dict[str, Any], change: str) -> pd.DataFrame:
    """Rows of `COLUMNS` of one run of a plan: the paper's findings by the CFD, and key numbers.

    The single finger beside it is that of the run's level where the change leaves the finger's own motion as it is.
    """
    files = files_of(run)
    comparable = all(part.startswith(FREE) for part in change.split("; ")) or change == AS_IT_IS
    evidence = load_evidence(files, files.level if comparable else run["run"])
    record = RUN.read(files.required("run/run.json", "run"))
    about = {"run": run["run"], "change": change, "openfoam": record["versions"]["OpenFOAM"]}
    about |= {key: record[key] for key in ("model", "cells", "steps")}
    about |= {"made_with": made_with(run), "measured_on": str(datetime.now(UTC).date())}
    rows: list[list[Any]] = []
    for finding in findings_of(run):
        check = judge(finding, evidence)
        value, met, note = (
            check["measured"]["cfd"],
            check["met_by"].get("cfd"),
            "; ".join(check["notes"]),
        )
        rows.append(["finding", finding.id, value, check["unit"], met, note])
    numbers = pinch_summary(evidence)
    numbers |= numbers["cfd"]
    for units in NUMBERS.values():
        rows += [
            ["number", name, numbers.get(name), unit, None, ""] for name, unit in units.items()
        ]
    for plane in evidence.planes.values():
        plane.close()
    return pd.DataFrame([about | dict(zip(ROW, row, strict=True)) for row in rows], columns=COLUMNS)


def with_numbers(words: str, table: pd.DataFrame) -> str:
    """`words` with the table's numbers for {run:quantity}, and for {run:quantity/other} by how much the run differs from another.

    "–" where a run was not made; ValueError where no run of the table has such a quantity.
    """
    values = {(row.run, row.quantity): (row.value, row.unit) for row in table.itertuples()}

    def number(place: re.Match[str]) -> str:
        run, name, other = place.groups()
        if name not in set(table["quantity"]):
            raise ValueError(
                f"{place[0]}: no run of the study has the quantity {name!r}; correct the words"
            )
        value, unit = values.get((run, name), (None, ""))
        if other is None or pd.isna(value):
            return _cell(value, unit)
        than = values.get((other, name), (None, ""))[0]
        return "–" if pd.isna(than) else f"{value / than - 1:+.0%}".replace("%", "\u00a0%")

    return re.sub(r"\{(\w+):([\w-]+)(?:/(\w+))?\}", number, words)


def page(words: str, table: pd.DataFrame, missing: dict[str, str], name: str) -> str:
    """The page as Markdown: the study's own words, then what was measured; its table and figure are called `name`."""
    parts = [
        with_numbers(words.strip(), table),
        f"Written by `make pinch-studies` from runs by OpenFOAM {' and '.join(table['openfoam'].unique())}, each with the numbers"
        f" that table, scene and findings have today; every number is in [{name}.csv]({name}.csv).",
        f"![Key numbers of every run]({name}.svg)",
    ]
    if missing:
        listed = "; ".join(f"{run} ({why})" for run, why in missing.items())
        parts.append(f"Not run, not to its end, or with other numbers: {listed}.")
    runs = table.drop_duplicates("run")[["run", "change", "model", "cells", "steps", "measured_on"]]
    parts.append(
        _markdown("Runs", [*map(_words, runs.columns)], runs.astype(str).to_numpy().tolist())
    )
    findings = table[table["kind"] == "finding"]
    rows = [
        [_words(name), *_finding(part)] for name, part in findings.groupby("quantity", sort=False)
    ]
    parts.append(
        _markdown(
            "The paper's findings, by the CFD",
            ["finding", "measured", "met in", "not met in"],
            rows,
        )
    )
    cells = {(row.run, row.quantity): _cell(row.value, row.unit) for row in table.itertuples()}
    for heading, units in NUMBERS.items():
        rows = [[run, *(cells.get((run, name), "–") for name in units)] for run in runs["run"]]
        parts.append(_markdown(heading, ["run", *map(_words, units)], rows))
    return "\n\n".join(parts) + "\n"


def _words(name: str) -> str:
    return name.replace("_", " ").replace("-", " ")


def _finding(part: pd.DataFrame) -> list[str]:
    """What all runs measure of one finding, from least to largest, in how many it is met, and where it is not."""
    known = sorted(part["value"].dropna().unique())
    ends = dict.fromkeys(_cell(value, part["unit"].iloc[0]) for value in (known[:1] + known[-1:]))
    judged = part[part["met"].notna()]
    missed = judged[~judged["met"].astype(bool)]
    named = [
        row.run + (f" ({row.note})" if pd.isna(row.value) else "") for row in missed.itertuples()
    ]
    none = (
        "all"
        if len(missed) > 1 and len(missed) == len(judged) and missed["value"].notna().all()
        else ", ".join(named)
    )
    return [" to ".join(ends) or "–", f"{len(judged) - len(missed)} of {len(judged)}", none or "–"]


def _markdown(heading: str, columns: list[str], rows: list[list[str]]) -> str:
    lines = [f"| {' | '.join(row)} |" for row in [columns, ["---"] * len(columns), *rows]]
    return "\n".join([f"## {heading}", "", *lines])


def _cell(value: Any, unit: str) -> str:
    return quantity(None if pd.isna(value) else value, unit)


def read_rows(path: Path) -> pd.DataFrame:
    """The table that was written before; no rows where there is none, or one of other columns."""
    table = (
        pd.read_csv(path, keep_default_na=False) if path.exists() else pd.DataFrame(columns=COLUMNS)
    )
    if list(table.columns) != COLUMNS:
        return pd.DataFrame(columns=COLUMNS)
    known = {"": None, "True": True, "False": False}
    return table.assign(value=table["value"].map(_value), met=table["met"].map(known))


def _value(text: Any) -> Any:
    """A cell as it was before it was written: a number, a word, or nothing."""
    try:
        return float(text)
    except ValueError:
        return text or None


def gather(plan: dict[str, Any], written: Path) -> tuple[pd.DataFrame, dict[str, str]]:
    """Rows of every run of a plan that was made with the plan's numbers, and why the others are missing, by name.

    Of a run whose results are not there the rows of the table `written` stay, where they were made with the same.
    """
    before = read_rows(written)
    tables, missing, listed = [], missing_runs(plan), changes(plan["runs"])
    for run in plan["runs"]:
        name = run["run"]
        if name not in missing:
            tables.append(measure(run, listed[name]))
            continue
        kept = before[before["run"] == name]
        if len(kept) and set(kept["made_with"]) == {made_with(run)}:
            tables.append(kept.assign(change=listed[name]))
            del missing[name]
    if not tables:
        raise FileNotFoundError(
            f"{plan['folder']}: no run of the study {plan['study']!r} was made; make pinch-studies"
        )
    return pd.concat(tables, ignore_index=True), missing


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command `judge`."""
    parser.add_argument("plan", type=Path, help="plan.json of the study")
    parser.add_argument("--words", type=Path, help="what the page begins with (.md)")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help="page, table and figure, no suffix"
    )


def run(args: argparse.Namespace) -> None:
    """Command `judge`."""
    plan = read_plan(args.plan)
    table, missing = gather(plan, args.output.with_suffix(".csv"))
    words = (
        args.words.read_text(encoding="utf-8")
        if args.words
        else f"# {plan['scene']}: {plan['study']}"
    )
    if missing:
        print(
            f"judge: {missing_sentence(missing, len(plan['runs']), 'the study again')}",
            file=sys.stderr,
        )
    write_text(args.output.with_suffix(".csv"), table.to_csv(index=False))
    save(draw_studies.bars(table), args.output.with_suffix(".svg"))
    write_text(args.output.with_suffix(".md"), page(words, table, missing, args.output.name))
