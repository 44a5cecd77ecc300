"""What the time step, the grid and a hundredth of the viscosity change, by windows of the stroke.

    python -m docs.evidence.sensitivity

writes docs/tradeoff/sensitivity.csv from runs of cases/single_finger/studies/tradeoff.csv.
"""

import sys

import pandas as pd

from docs.evidence.small_scene import ROOT
from piv.files.command import guarded
from piv.files.errors import StageError
from postprocess.tables import write_table
from softfinger.study.errors import errors_against, stroke_windows
from softfinger.study.table import files_of, middle_of_stroke, missing_runs, origin, read_plan

_SCENE = ROOT / "cases" / "single_finger"
_REMEDY = "run softfinger study cases/single_finger/studies/tradeoff.csv --only "
# what changes; the run that judges and the other
PAIRS = (
    ("time step of coarse: 1 against 0.5 ms", "coarse_05ms", "coarse"),
    ("time step of medium: 1 against 0.5 ms", "medium_05ms", "medium"),
    ("cells: coarse against medium, both 0.5 ms", "medium_05ms", "coarse_05ms"),
    ("cells: coarse against medium, both 1 ms", "medium", "coarse"),
    ("both: coarse at 1 ms against medium at 0.5 ms", "medium_05ms", "coarse"),
    ("viscosity of coarse 1 % larger", "coarse", "coarse_viscosity"),
)
_SHOWN = ("error_near_tip", "error_circulation", "error_centre_mm", "error_force")


def main() -> None:
    """Write the differences of each pair; StageError where a run is missing."""
    plan = read_plan(_SCENE / "out" / "studies" / "tradeoff" / "plan.json")
    names = sorted({name for _, *pair in PAIRS for name in pair})
    runs = [row for row in plan["runs"] if row["run"] in names]
    if missing := missing_runs({"runs": runs}):
        raise StageError(f"{', '.join(missing)}: not made yet; {_REMEDY}{','.join(names)}")
    files = {row["run"]: files_of(row) for row in runs}
    windows = stroke_windows(
        middle_of_stroke(files["medium"]), files["medium"].numbers.motion.end_time
    )
    rows = []
    for change, first, second in PAIRS:
        for start, end in windows:
            found = errors_against(files[first], files[second], "cfd", (start, end))
            window = {"change": change, "start_s": round(start, 4), "end_s": round(end, 4)}
            rows.append(window | {name: float(f"{found[name]:.2g}") for name in _SHOWN})
    table = ROOT / "docs" / "tradeoff" / "sensitivity.csv"
    write_table(table, pd.DataFrame(rows), origin(runs))


if __name__ == "__main__":
    sys.exit(guarded("sensitivity", main))
