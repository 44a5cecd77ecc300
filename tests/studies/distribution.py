"""Which cells, and which part of the scheme, decide the error of level coarse: one change at a time, judged by the finest grid.

python -m tests.studies.distribution   (make distribution): of the runs that are there, into docs/mesh.md
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd
from postprocess.studies.tradeoff_page import percent

from fileio.atomic import write_text
from fileio.command import guarded
from fileio.errors import StageError
from postprocess.studies.state import files_of, missing_runs
from postprocess.studies.table import read_plan, study_table
from postprocess.studies.tradeoff import errors_against, finest
from tests.studies.pages import libraries, write_between
from tests.studies.validation.finger import family

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "mesh.md"
SCENE = ROOT / "cases" / "single_finger"
BASE = "as_it_is"
FLOW = [f"cpu_{stage}_s" for stage in ("kinematics", "mesh", "case", "run")]


def measured() -> tuple[pd.DataFrame, str]:
    """Cells, cost and errors of the study's runs, by run, and the run of the family of grids that judges them."""
    found = family(SCENE)
    if found is None:
        raise StageError("distribution: no grids to judge by; make distribution runs them")
    _, window = found
    folder = SCENE / "out" / "studies"
    grids, plan = (read_plan(folder / name / "plan.json") for name in ("tradeoff", "distribution"))
    best = finest(grids, missing_runs(grids))
    missing = missing_runs(plan)
    if BASE in missing:
        raise StageError(
            "distribution: the level as it is has not been run; make distribution runs it"
        )
    judge = files_of(next(row for row in grids["runs"] if row["run"] == best))
    rows = [row for row in plan["runs"] if row["run"] not in missing]
    table = study_table(plan | {"runs": rows}, {}).set_index("run")
    table["cpu_flow_s"] = table[FLOW].sum(axis=1)
    base = next(row for row in rows if row["run"] == BASE)["overrides"]
    table["changed"] = [
        ", ".join(
            f"{key} = {value}" for key, value in row["overrides"].items() if base.get(key) != value
        )
        or "nothing"
        for row in rows
    ]
    errors = {row["run"]: errors_against(judge, files_of(row), "cfd", window) for row in rows}
    errors_of = pd.DataFrame.from_dict(errors, orient="index")
    return table.join(errors_of[errors_of.columns.difference(table.columns)]), best


def text_of(table: pd.DataFrame, best: str) -> str:
    """Markdown: what each change costs and does, in the order of the study."""
    columns = ("error_dorsal", "error_circulation", "error_velocity", "error_force", "error")
    lines = [
        "| changed | cells | CPU, s | centre, mm | x, y of it, mm | dorsal circulation, % | in a circle, % | velocity, % | force, % | worst, % |",
        "|" + "---|" * 10,
    ]
    for _, row in table.iterrows():
        parts = [
            row["changed"],
            f"{int(row['cells'])}",
            f"{row['cpu_flow_s']:.0f}",
            f"{row['error_centre_mm']:.2f}",
        ]
        parts += [f"{1e3 * row['x_cfd_m']:.2f}, {1e3 * row['y_cfd_m']:.2f}"]
        parts += [percent(row[name]) for name in columns]
        lines.append("| " + " | ".join(parts) + " |")
    return "\n".join(lines) + f"\n\nAgainst `{best}`; {libraries()}."


def main() -> None:
    """Command line."""

    def action() -> None:
        table, best = measured()
        write_text(
            SCENE / "studies" / "results" / "distribution.csv", table.to_csv(float_format="%.5g")
        )
        write_between(PAGE, "distribution", text_of(table, best))

    sys.exit(guarded("distribution", action))


if __name__ == "__main__":
    main()
