"""The numerical error of a level as an uncertainty of the comparison, and which level would do."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

COLUMNS = {"circulation": "error_circulation", "centre": "error_centre"}
UNIFORM = 3**-0.5  # standard deviation over the half-width of a uniform distribution
PLANE = {"circulation": 0.32, "centre": 0.07}  # of a plane flow that was not measured: smoke's


def level_uncertainties(scenes: list[Path], plane: bool) -> dict[str, dict[str, float]]:
    """Relative standard uncertainties by level and quantity, coarsest first; of places over the
    tip's width.

    `scenes`: the scene's folder and those that it extends, nearest first; the first with a
    studies/results/tradeoff.csv counts. `plane`: whether level smoke is a plane flow, whose error
    is that of single_finger's where none was measured.
    """
    for folder in scenes:
        path = folder / "studies" / "results" / "tradeoff.csv"
        if path.exists():
            table = pd.read_csv(path, comment="#")
            rows = table[(table["kind"] == "flow") & table["error"].notna()].sort_values("cells")
            return {
                str(row["level"]): {
                    name: UNIFORM * float(row[column])
                    for name, column in COLUMNS.items()
                    if pd.notna(row[column])
                }
                for _, row in rows.iterrows()
            }
    return {"smoke": PLANE} if plane else {}
