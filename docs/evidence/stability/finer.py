"""Runs repeated at half the time step and with cells 2/3 as large, and how far the first are off.

`python -m docs.evidence.stability.finer` writes the finer runs of those at the extremes as studies,
cases/<scene>/studies/stability_finer.csv. `softfinger study` makes them.
"""

import csv
import json
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from docs.evidence.stability import solver
from pipeline.formats.records import FORCES, RUN
from pipeline.runs.run import open_run
from pipeline.solve.guards import force_change
from piv.files.errors import StageError
from softfinger.study.outcome import outcome_is_there
from softfinger.study.rows import Row, read_study

SCENES = ("single_finger", "pinch")
WRONG = 0.2  # of peak force or impulse
FINER = "_fine"  # end of the name of a finer run
STEP, CELLS = 0.5, 2 / 3  # over those of the run
_SIZES = ("wall_cell", "tip_cell", "near_cell", "far_cell", "edge_layer", "sheet_layer")


def finer_row(row: Row, folder: Path) -> dict[str, Any]:
    """The study's row of the finer run; StageError where the scene refuses the run itself."""
    scene = open_run(folder, row.level, row.overrides, folder / "out" / "none").scene
    sizes = {name: getattr(scene.mesh, name) for name in _SIZES}
    numbers = {f"mesh.{name}": float(f"{CELLS * m:.4g}") for name, m in sizes.items() if m}
    numbers["numerics.time_step"] = STEP * scene.numerics.time_step
    about: dict[str, Any] = {"run": row.run + FINER, "level": row.level, "until": row.until}
    about |= {"ranks": row.ranks, "may_fail": "yes"}
    return about | {key: json.dumps(value) for key, value in (row.overrides | numbers).items()}


def write_study(path: Path, rows: Iterable[dict[str, Any]], about: str) -> None:
    """Write a study's table below a comment."""
    rows = list(rows)
    columns = dict.fromkeys(key for row in rows for key in row)
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(f"# {about}\n")
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def finer_runs(runs: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """The finer runs among `runs` that have been made, by the name of the run that each judges."""
    made = [run for run in runs if outcome_is_there(run)]
    return {r["run"].removesuffix(FINER): r for r in made if r["run"].endswith(FINER)}


def errors(run: dict[str, Any], finer: dict[str, Any] | None) -> dict[str, Any]:
    """How a run ended; of a completed one its errors against its `finer` run, if any."""
    about = solver.result(run)
    if finer is None or {about["ended"], solver.result(finer)["ended"]} != {"completed"}:
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


def main() -> None:
    """Write the studies of the finer runs; a run that its scene refuses has none."""
    for name in SCENES:
        folder, rows = Path("cases") / name, list[dict[str, Any]]()
        for row in read_study(folder / "studies" / "stability.csv"):
            with suppress(StageError):
                rows.append(finer_row(row, folder))
        about = "The runs of stability.csv at half the step and with cells 2/3 as large (finer.py)."
        write_study(folder / "studies" / "stability_finer.csv", rows, about)


if __name__ == "__main__":
    main()
