"""Drawn runs against finer ones at half the step: which are wrong without a warning?

`python -m docs.evidence.stability.drawn` draws the study
cases/single_finger/studies/drawn.csv. `softfinger study` makes its runs.
"""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from docs.evidence.stability import solver
from pipeline.formats.records import FORCES, RUN
from pipeline.solve.guards import force_change
from softfinger.study.outcome import outcome_is_there

TABLE = Path("cases/single_finger/studies/drawn.csv")
DRAWS = (("smoke", 41, 40), ("draft", 52, 12))  # level, seed, pairs
WRONG = 0.2  # of peak force or impulse
FINER = "_fine"  # end of the name of a finer run
STEP, CELLS = 0.5, 2 / 3  # over those of the run
_RESOLVED = 0.2  # change of the force below which the cells decide the error
_VARIED = ("numerics.time_step", "motion.strokes", "mesh.wall_cell")
# rates (Hz) at which both time steps (s) sample the sheet
_STEPS = {1e-3: 200, 2e-3: 250, 2.5e-3: 200, 4e-3: 250, 5e-3: 200, 8e-3: 125, 10e-3: 100}
_RISES = (0.1, 0.15, 0.2, 0.3, 0.4, 0.6)  # s
_MOST_STEPS = {"smoke": 200, "draft": 100}  # of a rise
_PRESSURES = (-20.0, 10.0, 20.0, 30.0)  # kPa
# over those of the level; draft refuses wall cells from 1.24 times its own
_CELLS = {"smoke": (0.8, 1.0, 1.25, 1.6), "draft": (1.0, 1.1, 1.2)}
_START, _REST = 0.005, 0.015  # s, before and after the rise
# of the levels, m: draft is in space
_SIZES = {
    "smoke": {"wall_cell": 2.4e-3, "tip_cell": 1.4e-3, "near_cell": 3e-3, "far_cell": 25e-3},
    "draft": {
        "wall_cell": 3.9e-3, "tip_cell": 0.65e-3, "near_cell": 1.5e-3, "far_cell": 37.5e-3,
        "edge_layer": 0.65e-3, "sheet_layer": 1.5e-3,
    },
}  # fmt: skip


def draw(level: str, seed: int, count: int) -> list[dict[str, Any]]:
    """Rows of the study: each drawn run, and one at half the step with finer cells."""
    random, rows = np.random.default_rng(seed), list[dict[str, Any]]()
    while len(rows) < 2 * count:
        step, rise = random.choice([*_STEPS]), random.choice(_RISES)
        kpa, cells = random.choice(_PRESSURES), random.choice(_CELLS[level])
        if rise / step > _MOST_STEPS[level]:
            continue
        end = step * np.ceil((_START + rise + _REST) / step)
        stroke = f'[{{"pressure_kpa": {kpa:g}, "start": {_START:g}, "duration": {rise:g}}}]'
        for end_of_name, part, size in (("", 1.0, cells), (FINER, STEP, CELLS * cells)):
            name = f"{level}_{seed}_{len(rows) // 2}{end_of_name}"
            about = {"run": name, "level": level, "until": "solve", "may_fail": "yes", "ranks": 1}
            motion = {"motion.strokes": stroke, "motion.end_time": f"{end:g}"}
            numbers = {"numerics.time_step": f"{part * step:g}", "sheet.rate_hz": _STEPS[step]}
            mesh = {f"mesh.{key}": f"{size * m:.4g}" for key, m in _SIZES[level].items()}
            rows.append(about | motion | numbers | mesh)
    return rows


def finer_runs(runs: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """The finer runs among `runs` that have been made, by the name of the run that each judges."""
    made = [run for run in runs if outcome_is_there(run)]
    return {r["run"].removesuffix(FINER): r for r in made if r["run"].endswith(FINER)}


def result(run: dict[str, Any], finer: dict[str, Any]) -> dict[str, Any]:
    """How a drawn run ended, with what was drawn; of a completed one its errors."""
    about = solver.result(run) | {key: run["overrides"].get(key, "") for key in _VARIED}
    if {about["ended"], solver.result(finer)["ended"]} != {"completed"}:
        return about
    record = RUN.read(_folder(run) / "run.json")
    (force, peak, impulse), (_, true_peak, true_impulse) = _force(run), _force(finer)
    found = {
        "error_peak": abs(peak / true_peak - 1),
        "error_impulse": float(np.hypot(*(impulse - true_impulse)) / np.hypot(*true_impulse)),
    }
    wrong, warned = max(found.values()) > WRONG, bool(record["power_balance"]["warning"])
    return about | {
        "ended": ("wrong" if warned else "UNWARNED") if wrong else "completed",
        **{name: round(error, 3) for name, error in found.items()},
        "force_change": round(force_change(force), 3),
        "unexplained_share": round(record["power_balance"]["unexplained_share"], 3),
        "warned": "yes" if warned else "no",
    }


def _folder(run: dict[str, Any]) -> Path:
    return Path(run["out"]) / "run"


def _force(run: dict[str, Any]) -> tuple[np.ndarray, float, np.ndarray]:
    """Force (step, axis) N of a run, its peak and its impulse (axis,) N s."""
    table = FORCES.read(_folder(run) / "forces.csv")
    force = table[["fx", "fy"]].to_numpy()
    return force, float(np.hypot(*force.T).max()), np.trapezoid(force, table["time"], axis=0)


def calibrated(table: pd.DataFrame) -> dict[str, float]:
    """What drawn pairs (drawn.csv) say of the warning of the time step.

    `factor`: error of peak force and impulse over the square of the force's change from step to
    step, at the 90th percentile of the runs whose change is at least _RESOLVED; `limit`: the
    largest error, by this factor, at which every wrong run is warned of; `unwarned`: the largest
    error of a run without a warning.
    """
    ended = table[table["ended"].isin(("completed", "wrong", "UNWARNED"))]
    error = ended[["error_peak", "error_impulse"]].astype(float).max(axis=1)
    change = ended["force_change"].astype(float)
    factor = float((error / change**2)[change >= _RESOLVED].quantile(0.9))
    return {
        "factor": factor,
        "limit": factor * float(change[error > WRONG].min()) ** 2,
        "unwarned": float(error[ended["warned"] == "no"].max()),
    }


def with_earlier(rows: pd.DataFrame, stages: dict[str, int], path: Path) -> pd.DataFrame:
    """`rows`, and those of an earlier table of the same `stages` that are not made anew."""
    if not path.exists():
        return rows
    with path.open(encoding="utf-8") as file:
        head = json.loads(file.readline()[1:])
    earlier = pd.read_csv(path, comment="#", dtype=object, keep_default_na=False)
    kept = earlier[~earlier["run"].isin(rows["run"]) & (head["stages"] == stages)]
    return pd.concat([rows, kept], ignore_index=True)


def main() -> None:
    """Write the study's table anew."""
    rows = [row for draws in DRAWS for row in draw(*draws)]
    about = "Drawn runs, each with one at half the step and with finer cells, by"
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        file.write(f"# {about} docs/evidence/stability/drawn.py.\n")
        columns = dict.fromkeys(key for row in rows for key in row)
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
