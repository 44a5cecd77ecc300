"""The finger itself on several grids and time steps: tip vortex, forces, and how far each is from the extrapolated value."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from fileio.formats.plane_series import read_plane
from pipeline.scene.scene import Scene, load_scene
from piv.vortices.find import find_vortices
from postprocess.evidence.dorsal_circulation import dorsal_circulation
from postprocess.evidence.tip_vortex import dominant_track, read_vortices
from postprocess.evidence.vortex_integral import CIRCLE, vortex_integrals
from postprocess.studies.state import files_of, missing_runs
from postprocess.studies.table import middle_of_stroke, read_plan
from postprocess.studies.tradeoff import PART_OF_STROKE
from tests.studies.validation.checks import Check, Result
from tests.studies.validation.convergence import Estimate, estimate
from tests.studies.validation.solve import CASES, solved

GRIDS = ("g141", "g100", "g071", "g050")
STEPS = ("dt200", "g100", "dt050", "dt025")
STUDY = (
    Path("out") / "studies" / "tradeoff" / "plan.json"
)  # its family of grids: make convergence, make tradeoff
JUDGED = {
    "coarse": 0.08,
    "medium": 0.04,
}  # levels, and what the uncertainty of the circulation may be there
NEAR_TIP = 3.0  # tip widths within which the tip's vortex is looked for
QUANTITIES = {
    "dorsal": ("circulation of the tip's dorsal side", "m²/s"),
    "circulation": ("tip-vortex circulation", "m²/s"),
    "x": ("x of its centre", "m"),
    "y": ("y of its centre", "m"),
    "peak_force": ("peak force", "N"),
    "impulse": ("impulse of the force along x", "N s"),
}


@dataclass(frozen=True)
class Run:
    """One run of the finger: representative cell size (m) and time step (s), and the quantities by name."""

    level: str
    cell: float
    time_step: float
    cells: int
    values: dict[str, float]


def tip_vortex(sheet: xr.Dataset, scene: Scene) -> pd.Series:
    """Circulations and centre of the strongest vortex on the dorsal side of the tip at half of the bend's change.

    By integrals over a circle, as in docs/tradeoff.md; the fit says where it is. ValueError where there is none.
    """
    bend = sheet["bend"].values[:, 0]
    half = int(np.argmin(np.abs(bend - 0.5 * (bend[0] + bend[-1]))))
    plane = sheet.isel(time=half)
    settings = scene.vortices
    vortices = find_vortices(plane[["u", "v", "valid"]], min_circulation=settings.min_circulation,
                          stencil_radius=settings.stencil_radius, weights=settings.weights)  # fmt: skip
    tip, dorsal = plane["tip"].values[0], plane["dorsal_direction"].values[0]
    reach = NEAR_TIP * float(sheet.attrs["tip_width"])
    near = [
        v for v in vortices
        if np.hypot(v.x - tip[0], v.y - tip[1]) < reach and np.dot((v.x - tip[0], v.y - tip[1]), dorsal) > 0
    ]  # fmt: skip
    if not near:
        raise ValueError(
            f"no vortex at the dorsal side of the tip of {scene.name} at level {scene.level}"
        )
    strongest = max(near, key=lambda v: abs(v.circulation))
    time = float(plane["time"])
    track = pd.DataFrame(
        [{"time": time, "x": strongest.x, "y": strongest.y, "circulation": strongest.circulation}]
    )
    return integrals_of(sheet, scene, track, (time, time))


def mean_vortex(sheet: xr.Dataset, scene: Scene, window: tuple[float, float]) -> pd.Series:
    """Circulations and centre of the tip's vortex as means over a window (s), by the same integrals.

    At single instants they differ between grids by when the shear layer's vortices pass the circle and pair.
    """
    track = dominant_track(read_vortices(scene.out / "vortices_cfd.csv"), 0, window, scene.level)
    return integrals_of(sheet, scene, track, window)


def integrals_of(
    sheet: xr.Dataset, scene: Scene, track: pd.DataFrame, window: tuple[float, float]
) -> pd.Series:
    """Means over a window (s): circulation, x, y within the circle round a tracked vortex, and `dorsal`, what is not prescribed of the
    dorsal side's circulation. ValueError where the circle holds nothing.
    """
    integrals = vortex_integrals(sheet, track, CIRCLE * float(sheet.attrs["tip_width"]), window)
    if integrals.empty:
        raise ValueError(
            f"the tip vortex of {scene.name} at level {scene.level} has nothing in its circle from {window[0]:g} to {window[1]:g} s"
        )
    means = integrals.mean()
    means["dorsal"] = dorsal_circulation(sheet, window)["of_water"].mean()
    return means


def read_run(scene: Scene, window: tuple[float, float] | None = None) -> Run:
    """Quantities of a run that is there: of the vortex at half stroke, or as means over a window (s)."""
    record = json.loads((scene.out / "run" / "run.json").read_text())
    table = np.genfromtxt(scene.out / "run" / "forces.csv", delimiter=",", names=True)
    with read_plane(scene.out / "sheet.h5") as sheet:
        vortex = mean_vortex(sheet, scene, window) if window else tip_vortex(sheet, scene)
    flat = scene.model.kind == "2d"
    area = scene.tank.size[0] * scene.tank.water_depth
    volume = (
        area if flat else area * scene.tank.size[2] * (0.5 if scene.model.kind == "half" else 1.0)
    )
    values = {
        "dorsal": abs(vortex.dorsal),
        "circulation": abs(vortex.circulation),
        "x": vortex.x,
        "y": vortex.y,
        "peak_force": float(np.hypot(table["fx"], table["fy"]).max()),
        "impulse": float(np.trapezoid(table["fx"], table["time"])),
    }
    cell = (volume / record["cells"]) ** (1 / 2 if flat else 1 / 3)
    return Run(scene.level, float(cell), scene.numerics.time_step, record["cells"], values)


def series(runs: list[Run], along: str) -> dict[str, Estimate]:
    """Estimate of each quantity along `cell` or `time_step`."""
    size = np.array([getattr(r, along) for r in runs])
    return {name: estimate(size, np.array([r.values[name] for r in runs])) for name in QUANTITIES}


def checks_of(
    runs: list[Run], along: str, judged: str, prefix: str, words: str, part: float = 0.1
) -> list[Check]:
    """Uncertainty of the judged level's circulation and forces as parts of the extrapolated value; the circulation's is at most `part`."""
    estimates = series(runs, along)
    at = [r.level for r in runs].index(judged)
    width = 1.0
    checks = []
    for name, (quantity, _) in QUANTITIES.items():
        e = estimates[name]
        if name in ("x", "y"):
            gap, scale, unit = 1e3 * float(e.uncertainty[at]), width, "mm"
            tolerance, why = 2.0, "an eighth of the tip's width"
        else:
            gap, scale, unit = float(e.uncertainty[at]), abs(e.extrapolated), "1"
            tolerance, why = (
                part if name in ("dorsal", "circulation") else 0.1,
                "what the comparison with a laboratory needs: of the size of the findings' own limits (reference/findings.toml)",
            )
        order = f", observed order {e.order:.2g}" if e.order is not None else ", no single order"
        checks.append(
            Check(f"{prefix}.{name}", f"{quantity}: uncertainty at {judged} {words}{order}", gap / scale, tolerance, "at most",
                  why, None, "", unit)
        )  # fmt: skip
    return checks


def curves_of(runs: list[Run], along: str) -> dict:
    """What the figure and the sentences need."""
    estimates = series(runs, along)
    return {
        "level": [r.level for r in runs], "cells": [r.cells for r in runs], along: [getattr(r, along) for r in runs],
        "quantities": {
            name: {
                "value": [r.values[name] for r in runs], "extrapolated": e.extrapolated, "order": e.order,
                "uncertainty": e.uncertainty.tolist(), "kind": e.kind,
            }
            for name, e in estimates.items()
        },
    }  # fmt: skip


def sentence(runs: list[Run], estimates: dict[str, Estimate], level: str) -> str:
    """What a user needs: how far a level is from the extrapolated value."""
    at = [r.level for r in runs].index(level)
    e = estimates["circulation"]
    gap = abs(runs[at].values["circulation"] / e.extrapolated - 1)
    bound = float(e.uncertainty[at]) / abs(e.extrapolated)
    return (
        f"At `{level}` Γ is within {gap:.1%} of the extrapolated value (uncertainty {bound:.1%})."
    )


def finest_orders(runs: list[Run]) -> str:
    """The observed orders of the three finest grids alone, of runs from coarse to fine."""
    finest = series(runs[-3:], "cell")
    parts = (
        f"{'no single order' if (order := finest[name].order) is None else f'{order:.2g}'} of the {' '.join(title.split()[-2:])}"
        for name, (title, _) in QUANTITIES.items()
        if name in ("dorsal", "circulation", "peak_force")
    )
    return f"Observed orders of the three finest grids alone: {', '.join(parts)}."


def two_dimensional() -> Result:
    """Grids and time steps of the 2-D finger."""
    grids = [read_run(solved("finger_2d", level)) for level in GRIDS]
    steps = [read_run(solved("finger_2d", level)) for level in STEPS]
    scene = load_scene(CASES / "finger_2d", "g100")
    checks = [
        *checks_of(grids, "cell", "g071", "finger_2d.grid", "(grid)"),
        *checks_of(steps, "time_step", "g100", "finger_2d.step", "(time step)"),
    ]
    remarks = (sentence(grids, series(grids, "cell"), "g071"),
               "Time step: " + sentence(steps, series(steps, "time_step"), "g100"))  # fmt: skip
    text = (
        "Level smoke's planform with every size times 1.41, 1, 0.71 and 0.5 at a time step of 1 ms, and steps of 2 to 0.25 ms"
        " on the second grid. Representative cell √(area / cells)."
    )
    curves = {"grid": curves_of(grids, "cell"), "step": curves_of(steps, "time_step")}
    return Result(
        "finger_2d", scene.title, text, tuple(checks), curves, remarks, _provenance(scene)
    )


def family(folder: Path) -> tuple[list[Scene], tuple[float, float]] | None:
    """The family of grids of the study of the scene in `folder`, from coarse to fine, and the window (s) in which they are compared.

    It begins where the middle half of a whole stroke begins. None where fewer than three grids have been run, or no whole stroke's kinematics.
    """
    if not (folder / STUDY).exists():
        return None
    plan = read_plan(folder / STUDY)
    missing = missing_runs(plan)
    there = [row for row in plan["runs"] if row["run"] not in missing]
    grids = [row for row in there if PART_OF_STROKE in row["overrides"]]
    # of a whole stroke its motion is enough
    whole = [
        row
        for row in plan["runs"]
        if PART_OF_STROKE not in row["overrides"]
        and files_of(row).optional("kinematics.h5") is not None
    ]
    if len(grids) < 3 or not whole:
        return None
    scenes = [load_scene(Path(row["folder"]), row["level"]) for row in grids]
    begin, end = middle_of_stroke(files_of(whole[0]))
    return scenes, (begin, min(end, scenes[0].motion.end_time))


def three_dimensional(folder: Path) -> Result | None:
    """The family of grids of the study of the scene in `folder`; None where fewer than three have been run."""
    found = family(folder)
    if found is None:
        return None
    scenes, window = found
    runs = [read_run(scene, window) for scene in scenes]
    checks = [
        check
        for level, part in JUDGED.items()
        if level in {r.level for r in runs}
        for check in checks_of(runs, "cell", level, f"finger.{level}", "(grid)", part)
    ]
    text = (
        f"{folder.name} at its levels {', '.join(r.level for r in runs)}: a family of grids whose sizes all shrink by 2/3, all at"
        f" {1e3 * runs[0].time_step:g} ms and to {scenes[0].motion.end_time:g} s. Circulation and centre are means from {window[0]:.3f} s, where the"
        f" middle half of the stroke begins, to {window[1]:.3f} s; of the dorsal side's, the part that is not prescribed. Representative cell ∛(volume / cells)."
    )
    remarks = (*(sentence(runs, series(runs, "cell"), r.level) for r in runs), finest_orders(runs))
    return Result("finger", f"Grid convergence of {folder.name}", text, tuple(checks), {"grid": curves_of(runs, "cell")}, remarks,
                  _provenance(scenes[0]))  # fmt: skip


def _provenance(scene: Scene) -> dict:
    path = scene.out / "run" / "run.json"
    record = json.loads(path.read_text())
    return {
        "versions": {"OpenFOAM": record["versions"]["OpenFOAM"]},
        "scene_hash": record["scene_hash"],
        "level": scene.level,
    }
