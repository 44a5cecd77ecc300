"""What of the pinch's jet after contact depends on the grid, and what does not: cases/pinch/studies/jet.csv, into docs/mesh.md.

python -m tests.studies.pinch_jet   (make pinch-jet): of the runs that are there
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from fileio.command import guarded
from fileio.errors import StageError
from fileio.formats.plane_series import read_plane
from fileio.formats.records import RUN
from pipeline.scene.scene import load_scene
from piv.vortices.circulation import distance_to_invalid
from piv.vortices.criteria import gradients, vorticity
from postprocess.evidence.centreline import halves_of
from postprocess.evidence.fields import frame
from postprocess.evidence.load import read_clock
from postprocess.evidence.vortex_integral import CLEAR
from postprocess.studies.state import files_of, missing_runs
from postprocess.studies.table import read_plan
from tests.studies.pages import libraries, write_between
from tests.studies.validation.convergence import three_grids

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "mesh.md"
PLAN = ROOT / "cases" / "pinch" / "out" / "studies" / "jet" / "plan.json"
AFTER = 0.07  # s after contact: until then means are taken, and the quarter models' jets have been at their fastest
LATE = 0.15  # s after contact: until then the fastest is looked for, as for docs/pinch_studies.md
DEPTH = 1.5  # tip widths below the tips: where the quarter models' jets are at their fastest
FAMILIES = (("coarse", "medium", "fine"), ("plane_coarse", "plane_medium", "plane_fine"))
# what is measured, its unit and digits; from mean_speed on, means over AFTER
COLUMNS = {
    "fastest": ("fastest on x = 0, m/s", 3),
    "time": ("ms after contact", 0),
    "depth": ("mm below the tips", 1),
    "width": ("width there, mm", 1),
    "width_in_cells": ("in cells", 1),
    "flux": ("volume flux there, cm²/s", 1),
    "mean_speed": ("mean: speed, m/s", 3),
    "mean_flux": ("volume flux, cm²/s", 1),
    "mean_momentum": ("momentum flux, cm³/s²", 0),
    "circulation": ("circulation of the dorsal vortex, cm²/s", 1),
    "from_plane": ("its distance from x = 0, mm", 2),
    "below": ("its depth, mm", 1),
}
JUDGED = [name for name in COLUMNS if name not in ("time", "width_in_cells")]  # have an order


def stream(down: np.ndarray, x: np.ndarray) -> tuple[float, float, float, float]:
    """Of the downward speed (m/s) over x (m): that on x = 0, the width (m), ∫v dx and ∫v² dx of the stream round it; zeros where it is up.

    It ends where the speed, linear between samples, is zero; beside NaN (a body, the field's edge) half a step beyond its last sample.
    """
    down = np.pad(down, 1, constant_values=np.nan)
    middle, step = int(np.argmin(np.abs(x))) + 1, float(x[1] - x[0])
    stops = np.flatnonzero(~(down > 0))
    if middle in stops:
        return 0.0, 0.0, 0.0, 0.0
    before, after = stops[stops < middle].max(), stops[stops > middle].min()
    inside = down[before + 1 : after]
    last, beyond = inside[[0, -1]], down[[before, after]]
    ends = np.where(np.isnan(beyond), 0.5, last / (last - beyond))
    width = (inside.size - 1 + ends.sum()) * step
    return float(down[middle]), float(width), inside.sum() * step, (inside**2).sum() * step


def summit(values: np.ndarray, k: int) -> float:
    """Place, in samples from the largest, `k`, of the maximum of the parabola through it and its neighbours; 0 where it is no maximum."""
    before, at, after = values[k - 1 : k + 2]
    curvature = before - 2 * at + after
    return (
        float((before - after) / (2 * curvature))
        if max(before, after) <= at and curvature < 0
        else 0.0
    )


def dorsal_vortex(plane: xr.Dataset, index: int, top: float) -> tuple[float, float, float]:
    """Circulation (m²/s) and centroid x, y (m) of the right half's dorsal sense below `top` (m), farther than CLEAR from a body."""
    x, y = plane["x"].values, plane["y"].values
    dx, dy = float(x[1] - x[0]), float(y[1] - y[0])
    (u, v), valid = frame(plane, index)
    omega = np.nan_to_num(vorticity(gradients(u, v, valid, dx, dy, "least-squares")))
    away = distance_to_invalid(valid, dx, dy) > CLEAR * float(plane.attrs["tip_width"])
    right = halves_of(x)[1]
    part = np.where(away & right & (y < top)[:, None], np.maximum(omega, 0.0), 0.0)
    total = part.sum()
    return float(total * dx * dy), float((part @ x).sum() / total), float((y @ part).sum() / total)


def measured(plane: xr.Dataset, met: float, cell: float) -> dict[str, float]:
    """`COLUMNS` of a plane series whose tips meet at `met` (s); `cell`: of the water about the jet, m.

    Besides `until`, ms after contact until which the fastest was looked for, and `at_end`, whether it was found at the last instant.
    """
    x, y, times, tips = (plane[name].values for name in ("x", "y", "time", "tip"))
    width = float(plane.attrs["tip_width"])
    met_at = int(np.argmin(np.abs(times - met)))
    tip = float(tips[met_at, :, 1].mean())
    below = np.flatnonzero(y < tip - width / 2)
    row = int(np.argmin(np.abs(y - (tip - DEPTH * width))))
    fastest: tuple[float, ...] = (0.0,) * 6
    means = []
    looked = np.flatnonzero((times >= times[met_at]) & (times <= met + LATE))
    for index in looked:
        (_, v), valid = frame(plane, int(index))
        down = -np.where(valid, v, np.nan)
        on_middle = down[:, int(np.argmin(np.abs(x)))]
        k = below[int(np.nanargmax(on_middle[below]))]
        now = stream(down[k], x)
        if now[0] > fastest[0]:
            fastest = (
                *now,
                times[index] - met,
                tip - y[k] - summit(on_middle, k) * float(y[1] - y[0]),
            )
        if times[index] <= met + AFTER:
            means.append(
                [*stream(down[row], x), *dorsal_vortex(plane, int(index), tip - width / 2)]
            )
    speed, _, flux, momentum, circulation, from_plane, height = np.mean(means, axis=0)
    return {
        "fastest": fastest[0], "time": 1e3 * fastest[4], "depth": 1e3 * fastest[5], "width": 1e3 * fastest[1],
        "width_in_cells": fastest[1] / cell, "flux": 1e4 * fastest[2], "mean_speed": speed, "mean_flux": 1e4 * flux,
        "mean_momentum": 1e6 * momentum, "circulation": 1e4 * circulation, "from_plane": 1e3 * from_plane,
        "below": 1e3 * (tip - height), "until": 1e3 * min(LATE, times[-1] - met),
        "at_end": fastest[4] == times[looked[-1]] - met,
    }  # fmt: skip


def order(values: list[float]) -> str:
    """Observed order of three grids, each 2/3 of the one before, coarse first; none where the differences do not shrink."""
    try:
        found = three_grids((2 / 3) ** np.arange(3), np.array(values)).order
    except ValueError:
        return "none"
    return f"{found:.1f}"


def text_of(rows: dict[str, dict[str, float]], runs: dict[str, dict[str, Any]]) -> str:
    """Markdown: what each run says, and under a family of grids the orders of it."""
    lines = [
        "| run | cells | cells about the jet, mm | "
        + " | ".join(head for head, _ in COLUMNS.values())
        + " |",
        "|" + "---|" * (len(COLUMNS) + 3),
    ]
    for name, row in rows.items():
        parts = [
            name.replace("_", " "),
            f"{runs[name]['cells']}",
            f"{1e3 * runs[name]['cell']:.2f}",
        ]
        figures = {key: f"{row[key]:.{digits}f}" for key, (_, digits) in COLUMNS.items()}
        figures["time"] += " (last)" if row["at_end"] else ""
        parts += figures.values()
        lines.append("| " + " | ".join(parts) + " |")
        for family in FAMILIES:
            if name == family[-1] and set(family) <= set(rows):
                orders = [
                    order([rows[k][key] for k in family]) if key in JUDGED else ""
                    for key in COLUMNS
                ]
                lines.append(
                    f"| order, {family[0].replace('_', ' ')} to fine | | | {' | '.join(orders)} |"
                )
    return "\n".join(lines)


def main() -> None:
    """Command line."""

    def action() -> None:
        plan = read_plan(PLAN)
        missing = missing_runs(plan)
        rows, runs = {}, {}
        for run in plan["runs"]:
            if run["run"] in missing:
                continue
            files = files_of(run)
            cell = load_scene(files.scene_folder, files.level).mesh.near_cell
            runs[run["run"]] = {
                "cells": RUN.read(files.out / "run" / "run.json")["cells"],
                "cell": cell,
            }
            with read_plane(files.out / "sheet.h5") as plane:
                met = read_clock(files.out / "kinematics.h5", plane).met()
                if met is None:
                    raise StageError(
                        f"{run['run']}: the tips do not meet; give a longer motion.end_time"
                    )
                if plane["time"].values[-1] < met + AFTER:
                    raise StageError(
                        f"{run['run']}: sheet.h5 ends earlier than {AFTER * 1e3:.0f} ms after contact; give a longer motion.end_time"
                    )
                rows[run["run"]] = measured(plane, met, cell)
        if not rows:
            raise StageError("pinch_jet: no run is there; make pinch-jet runs them")
        short = ", ".join(
            f"{name.replace('_', ' ')} to its end at {row['until']:.0f} ms"
            for name, row in rows.items()
            if row["until"] < LATE * 1e3
        )
        within = f"Fastest within {LATE * 1e3:.0f} ms of contact{f' ({short})' if short else ''}; last: at the last instant of it, no peak;"
        about = f"{within} means over {AFTER * 1e3:.0f} ms, those of the stream {DEPTH:g} tip widths below the tips; {libraries()}."
        write_between(PAGE, "jet", f"{text_of(rows, runs)}\n\n{about}")

    sys.exit(guarded("pinch_jet", action))


if __name__ == "__main__":
    main()
