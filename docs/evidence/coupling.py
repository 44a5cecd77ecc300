"""The contact of coupled fingers at two time steps.

    python -m docs.evidence.coupling

writes docs/coupling/contact.csv of the runs of cases/pinch/studies/contact.csv that have been made.
"""

import sys

from docs.evidence.small_scene import ROOT
from piv.files.command import guarded
from piv.files.errors import StageError
from postprocess.tables import write_table
from softfinger.study.table import missing_runs, origin, read_plan, study_table

_PLAN = ROOT / "cases" / "pinch" / "out" / "studies" / "contact" / "plan.json"
_SHOWN = {
    "contact_force_N": ("largest force, mN", 1e3),
    "contact_impulse_Ns": ("impulse of 50 ms, mN s", 1e3),
    "rebound_m": ("rebound, mm", 1e3),
    "tip_change_m": ("check: tip, mm", 1e3),
    "open_energy": ("check: energy, %", 1e2),
}


def main() -> None:
    """Write the table; StageError where no run has been made."""
    plan = read_plan(_PLAN) if _PLAN.exists() else {"runs": []}
    missing = missing_runs(plan)
    rows = [row for row in plan["runs"] if row["run"] not in missing]
    if not rows:
        raise StageError("run softfinger study cases/pinch/studies/contact.csv: no run is there")
    table = study_table(plan | {"runs": rows}, {})
    shown = table[["run", "level", "time_step_s"]].copy()
    for name, (words, factor) in _SHOWN.items():
        shown[words] = [float(f"{factor * value:.4g}") for value in table[name]]
    write_table(ROOT / "docs" / "coupling" / "contact.csv", shown, origin(rows))


if __name__ == "__main__":
    sys.exit(guarded("coupling", main))
