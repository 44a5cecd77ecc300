"""The numerical error of a level as an uncertainty of the comparison, and which level would do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

COLUMNS = {"circulation": "error_circulation", "centre": "error_centre"}
UNIFORM = 3**-0.5  # standard deviation over the half-width of a uniform distribution
# of level smoke, a plane flow, where nothing was measured: single_finger's; and of a vortex that a
# level does not have
PLANE, LOST = {"circulation": 0.32, "centre": 0.07}, 1.0
EMPTY = pd.DataFrame(columns=["run", "start_s", "end_s", *COLUMNS])


def level_windows(scenes: list[Path], plane: bool) -> pd.DataFrame:
    """Relative standard uncertainties by `run` (a level) and window of time, coarsest level first.

    Columns `start_s`, `end_s` and one by quantity, of places over the tip's width; none of a level
    that was not measured. `scenes`: the scene's folder and those that it extends, nearest first;
    the first with studies/results counts. `plane`: whether the run's flow is plane.
    """
    for folder in scenes:
        results = folder / "studies" / "results"
        if (path := results / "errors.csv").exists():
            table = pd.read_csv(path, comment="#")
            table = table[table.groupby("run")["error"].transform("count") > 0]
        elif (path := results / "tradeoff.csv").exists():  # of the first part, for the whole stroke
            table = pd.read_csv(path, comment="#").sort_values("cells")
            if not {*COLUMNS.values()} <= {*table}:
                continue
            table = table[table["error"].notna() & (table["kind"] == "flow")]
            table = table.assign(start_s=0.0, end_s=np.inf)
        else:
            continue
        known = {name: UNIFORM * table[of].fillna(LOST) for name, of in COLUMNS.items()}
        return table.assign(**known)[list(EMPTY)].reset_index(drop=True)
    return (
        pd.DataFrame([{"run": "smoke", "start_s": 0.0, "end_s": np.inf, **PLANE}])
        if plane
        else EMPTY
    )


def level_uncertainty(
    windows: pd.DataFrame, level: str, during: tuple[float, float]
) -> dict[str, float]:
    """The largest relative standard uncertainty of each quantity `during` (s); empty: unknown."""
    rows = windows[windows["run"] == level]
    met = rows[(rows["start_s"] < during[1]) & (rows["end_s"] > during[0])]
    rows = (
        met if len(met) else rows.tail(1)
    )  # after the last window its error is the least there is
    return {name: float(rows[name].max()) for name in COLUMNS} if len(rows) else {}
