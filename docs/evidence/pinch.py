"""`python -m docs.evidence.pinch`: writes docs/record/pinch_variations.csv.

Findings and numbers (SI) of the runs of cases/pinch/studies/variations.csv and
variations_dear.csv that have been made.
"""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.formats.records import RUN
from pipeline.runs.run import Run, run_of
from postprocess.compare.findings import read_findings
from postprocess.compare.pinch_summary import pinch_summary
from postprocess.compare.quantities import QUANTITIES
from postprocess.compare.stage import judge
from postprocess.evidence.evidence import Evidence
from postprocess.evidence.load import load_evidence
from postprocess.evidence.stage_files import StageFiles
from postprocess.tables import write_table
from softfinger.study.plan import describe
from softfinger.study.rows import read_study

HOME = Path(__file__).resolve().parents[2] / "cases" / "pinch"
TABLE = HOME.parents[1] / "docs" / "record" / "pinch_variations.csv"


def head_of(name: str, run: Run) -> dict[str, Any]:
    """Describe a run: its changed values, model, size and date."""
    record = RUN.read(run.out / "run" / "run.json")
    return {
        "run": name,
        "change": "; ".join(f"{k} = {v}" for k, v in run.overrides.items()) or "as it is",
        **{key: record[key] for key in ("model", "cells", "steps")},
        "made_with": run.digest("solve")[:16],
        "measured_on": datetime.now(UTC).date().isoformat(),
        "openfoam": record["versions"]["OpenFOAM"],
    }


def rows_of(name: str, run: Run, evidence: Evidence) -> pd.DataFrame:
    """Tabulate a run's findings of the CFD and its numbers, a row each."""
    head = head_of(name, run)
    findings = read_findings(HOME / "reference" / "findings.toml", frozenset(QUANTITIES))
    checks = [judge(f, evidence) for f in findings if f.kind == "paper" and "cfd" in f.of]
    rows = [
        {"kind": "finding", "quantity": c["id"], "value": c["measured"]["cfd"], "unit": c["unit"],
         "met": c["met_by"].get("cfd"), "note": " ".join(c["notes"])}
        for c in checks
    ]  # fmt: skip
    numbers = pinch_summary(evidence)
    numbers |= numbers.pop("cfd")
    rows += [{"kind": "number", "quantity": k, "value": v} for k, v in numbers.items()]
    return pd.DataFrame([head | row for row in rows])


def main() -> None:
    """Write the table; rows of runs that are not made stay."""
    parts: list[pd.DataFrame] = []
    studies = "variations", "variations_dear"
    rows = [(n, row) for n in studies for row in read_study(HOME / "studies" / f"{n}.csv")]
    for name, row in rows:
        run = run_of(describe(HOME, name, row))
        if not run.stale("vortices_cfd"):
            parts.append(rows_of(row.run, run, load_evidence(StageFiles(run.scene))))
            print(row.run, flush=True)
    if TABLE.exists():
        old = pd.read_csv(TABLE)
        made = {run for part in parts for run in part["run"]}
        parts = [old[~old["run"].isin(made)], *parts]
    write_table(TABLE, pd.concat(parts))


if __name__ == "__main__":
    main()
