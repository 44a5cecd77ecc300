"""The finger on several grids and time steps: tip vortex, forces, and their uncertainties."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from docs.evidence.dorsal_circulation import dorsal_circulation
from docs.evidence.validation.checks import Check, Result
from docs.evidence.validation.convergence import Estimate, estimate
from docs.evidence.validation.solve import record_of, solved, stage_versions
from pipeline.runs.run import run_of
from pipeline.scene.scene import Scene
from piv.formats.plane_series import read_plane
from postprocess.evidence.stage_files import StageFiles
from postprocess.evidence.tip_vortex import COMPARED, dominant_track, read_vortices
from softfinger.study.table import middle_of_stroke, missing_runs, read_plan

GRIDS = ("g141", "g100", "g071", "g050")
STEPS = ("dt200", "g100", "dt050", "dt025")
STUDY = Path("out") / "studies" / "tradeoff" / "plan.json"  # its levels
JUDGED = {"coarse": 0.08, "medium": 0.04}  # levels: largest uncertainty of the circulation
QUANTITIES = {
    "dorsal": "circulation of the tip's dorsal side",
    "circulation": "tip-vortex circulation",
    "x": "x of its centre",
    "y": "y of its centre",
    "peak_force": "peak force",
    "impulse": "impulse of the force along x",
}


@dataclass(frozen=True)
class Run:
    """A run: representative cell size (m), time step (s), number of cells, quantities by name."""

    level: str
    cell: float
    time_step: float
    cells: int
    values: dict[str, float]


def _tip_vortex(sheet: xr.Dataset, scene: Scene, window: tuple[float, float] | None) -> pd.Series:
    """Means over a window (s) of the tip vortex's circulation, x, y and peak vorticity.

    At half of the bend's change where there is none. `dorsal`: that part of the dorsal side's
    circulation which is not prescribed. Single instants differ between grids: the shear layer's
    vortices pass and pair.
    """
    if window is None:
        bend = sheet["bend"].values[:, 0]
        half = int(np.argmin(np.abs(bend - 0.5 * (bend[0] + bend[-1]))))
        window = (float(sheet["time"][half]),) * 2
    table = read_vortices(scene.out / "vortices_cfd.csv")
    track = dominant_track(table, 0, window, scene.level)
    means = track.loc[track["time"].between(*window), list(COMPARED)].mean()
    means["dorsal"] = dorsal_circulation(sheet, window)["of_water"].mean()
    return means


def _read_run(scene: Scene, window: tuple[float, float] | None = None) -> Run:
    """Quantities of a run, of the vortex at half stroke or as means over a window (s)."""
    cells = record_of(scene)["cells"]
    table = np.genfromtxt(scene.out / "run" / "forces.csv", delimiter=",", names=True)
    with read_plane(scene.out / "sheet.h5") as sheet:
        vortex = _tip_vortex(sheet, scene, window)
    flat, size = scene.model.kind == "2d", scene.tank.size[0] * scene.tank.water_depth
    if not flat:
        size *= scene.tank.size[2] * (0.5 if scene.model.kind == "half" else 1.0)
    values = {name: abs(vortex[name]) for name in ("dorsal", "circulation")}
    values |= {"x": vortex.x, "y": vortex.y}
    values["peak_force"] = float(np.hypot(table["fx"], table["fy"]).max())
    values["impulse"] = float(np.trapezoid(table["fx"], table["time"]))
    cell = float((size / cells) ** (1 / 2 if flat else 1 / 3))
    return Run(scene.level, cell, scene.numerics.time_step, cells, values)


def series(runs: list[Run], along: str) -> dict[str, Estimate]:
    """Estimate of each quantity along `cell` or `time_step`."""
    size = np.array([getattr(r, along) for r in runs])
    return {name: estimate(size, np.array([r.values[name] for r in runs])) for name in QUANTITIES}


def checks_of(
    runs: list[Run], along: str, judged: str, prefix: str, words: str, part: float = 0.1
) -> list[Check]:
    """Uncertainties of a level: centre in mm, others as parts of the extrapolated value.

    `part`: largest uncertainty of the circulations.
    """
    estimates = series(runs, along)
    at = [r.level for r in runs].index(judged)
    use = (
        "what the comparison with a laboratory needs: of the size of the findings' own limits"
        " (reference/findings.toml)"
    )
    checks = []
    for name, quantity in QUANTITIES.items():
        e = estimates[name]
        if name in ("x", "y"):
            gap, unit = 1e3 * float(e.uncertainty[at]), "mm"
            tolerance, why = 2.0, "an eighth of the tip's width"
        else:
            gap, unit = float(e.uncertainty[at]) / abs(e.extrapolated), "1"
            tolerance, why = part if name in ("dorsal", "circulation") else 0.1, use
        order = "no single order" if e.order is None else f"observed order {e.order:.2g}"
        text = f"{quantity}: uncertainty at {judged} {words}, {order}"
        row = f"{prefix}.{name}", text, gap, tolerance
        checks.append(Check(*row, "at most", why, unit=unit))
    return checks


def curves_of(runs: list[Run], along: str) -> dict:
    """Values and estimates for the figure."""
    quantities = {
        name: vars(e)
        | {"value": [r.values[name] for r in runs], "uncertainty": list(e.uncertainty)}
        for name, e in series(runs, along).items()
    }
    columns = {name: [getattr(r, name) for r in runs] for name in ("level", "cells", along)}
    return {**columns, "quantities": quantities}


def two_dimensional() -> Result:
    """Grids and time steps of the 2-D finger."""
    scenes = {row: solved(row, "convergence", "vortices_cfd") for row in {*GRIDS, *STEPS}}
    grids, steps = ([_read_run(scenes[row]) for row in rows] for rows in (GRIDS, STEPS))
    scene = scenes["g100"]
    checks = [
        *checks_of(grids, "cell", "g071", "finger_2d.grid", "(grid)"),
        *checks_of(steps, "time_step", "g100", "finger_2d.step", "(time step)"),
    ]
    curves = {"grid": curves_of(grids, "cell"), "step": curves_of(steps, "time_step")}
    origin = _provenance(scene)
    return Result("finger_2d", scene.title, tuple(checks), curves, origin)


def _family(folder: Path) -> list[Scene]:
    """The levels in space of a scene's study, from coarse to fine, each as it is, that were made.

    Such a run has its level's name.
    """
    if not (folder / STUDY).exists():
        return []
    plan = read_plan(folder / STUDY)
    rows = [row for row in plan["runs"] if row["run"] == row["level"]]
    missing = missing_runs({"runs": rows})
    scenes = [run_of(row).scene for row in rows if row["run"] not in missing]
    in_space = [scene for scene in scenes if scene.model.kind != "2d"]
    return sorted(in_space, key=lambda scene: record_of(scene)["cells"])


def three_dimensional(folder: Path) -> Result | None:
    """The family of grids of the scene in `folder`; None where fewer than three have been run."""
    scenes = _family(folder)
    if len(scenes) < 3:
        return None
    window = middle_of_stroke(StageFiles(scenes[-1]))
    runs = [_read_run(scene, window) for scene in scenes]
    levels = [r.level for r in runs]
    checks = []
    for level in [known for known in JUDGED if known in levels]:
        checks += checks_of(runs, "cell", level, f"finger.{level}", "(grid)", JUDGED[level])
    curves, title = {"grid": curves_of(runs, "cell")}, f"Grid convergence of {folder.name}"
    return Result("finger", title, tuple(checks), curves, _provenance(scenes[0]))


def _provenance(scene: Scene) -> dict:
    versions = {"OpenFOAM": record_of(scene)["versions"]["OpenFOAM"]}
    stages = stage_versions("vortices_cfd")
    return {"versions": versions, "level": scene.level, "stages": stages}
