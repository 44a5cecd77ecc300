"""Coupled runs: checks and cost of strokes, and the contact at two time steps.

    python -m docs.evidence.coupling

writes docs/coupling/runs.csv and contact.csv from cases/single_finger/studies/coupling.csv and
cases/pinch/studies/contact.csv, of the runs that have been made.
"""

import sys

import pandas as pd

from docs.evidence.small_scene import ROOT
from piv.files.command import guarded
from piv.files.errors import StageError
from postprocess.tables import write_table
from softfinger.study.table import missing_runs, origin, read_plan, study_table

FOLDER = ROOT / "docs" / "coupling"
_PRESCRIBED = "_prescribed"  # end of the name of the run without coupling
_CONTACT = {
    "contact_force_N": ("largest force, mN", 1e3),
    "contact_impulse_Ns": ("impulse of 50 ms, mN s", 1e3),
    "rebound_m": ("rebound, mm", 1e3),
    "tip_change_m": ("check: tip, mm", 1e3),
    "open_energy": ("check: energy, %", 1e2),
}


def runs_of(scene: str, study: str) -> tuple[pd.DataFrame, list[dict]]:
    """The table and the plan's rows of those runs of a study that have been made; StageError."""
    path = ROOT / "cases" / scene / "out" / "studies" / study / "plan.json"
    plan = read_plan(path) if path.exists() else {"runs": []}
    missing = missing_runs(plan)
    rows = [row for row in plan["runs"] if row["run"] not in missing]
    if not rows:
        raise StageError(f"run softfinger study cases/{scene}/studies/{study}.csv: no run is there")
    return study_table(plan | {"runs": rows}, {}).set_index("run"), rows


def rounded(value: float) -> float:
    """Round a number to four digits."""
    return float(f"{value:.4g}")


def contact(table: pd.DataFrame) -> pd.DataFrame:
    """Force, impulse and rebound of each run, and of the check of its motion."""
    out = table[["level", "time_step_s"]].copy()
    for name, (words, factor) in _CONTACT.items():
        out[words] = (factor * table[name]).map(rounded)
    return out


def strokes(table: pd.DataFrame) -> pd.DataFrame:
    """The check of each coupled run and its CPU time over that of the prescribed run."""
    coupled = table[~table.index.str.endswith(_PRESCRIBED)]
    other = table["cpu_solve_s"].reindex(coupled.index + _PRESCRIBED).to_numpy()
    numbers = {
        "check: tip, mm": 1e3 * coupled["tip_change_m"],
        "check: energy, %": 1e2 * coupled["open_energy"],
        "cost over prescribed": coupled["cpu_solve_s"] / other,
    }
    return coupled[["level"]].assign(**{n: column.map(rounded) for n, column in numbers.items()})


def main() -> None:
    """Write the two tables; StageError where no run of a study has been made."""
    for scene, study, name, tabulate in (
        ("pinch", "contact", "contact", contact),
        ("single_finger", "coupling", "runs", strokes),
    ):
        table, rows = runs_of(scene, study)
        write_table(FOLDER / f"{name}.csv", tabulate(table).reset_index(), origin(rows))


if __name__ == "__main__":
    sys.exit(guarded("coupling", main))
