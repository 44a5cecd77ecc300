"""What an interval's case needs before the solver: ranks, the flow it starts from, and the frames of the motion."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import xarray as xr
from tqdm import tqdm

from fileio.atomic import write_text
from fileio.errors import StageError
from fileio.formats.mesh_intervals import Interval, read_planform
from fileio.formats.node_motion import read_motion
from fileio.formats.sweep import read_sweep
from fileio.json_text import read_json
from pipeline.geometry.quality import cell_centres, neighbours, planform_edges
from pipeline.openfoam.displacement_files import PADDING, steps_of, time_name, write_frames
from pipeline.openfoam.environment import COLLATED, run_tool
from pipeline.openfoam.foamfile import labels_of, write_list
from pipeline.openfoam.ranks import Ranks
from pipeline.run.map_fields import map_fields
from pipeline.run.partition import partition_columns
from pipeline.run.solver import PROGRESS, set_number
from pipeline.scene.scene import Scene

STATE = "state.json"  # what the frames and the decomposition in an interval's folder were made for


def case_state(case: Path, ranks: Ranks) -> dict[str, int]:
    """What frames, decomposition and fields in `case` belong to."""
    points = case / "constant" / "polyMesh" / "points"
    if not points.exists():
        raise StageError(f"{case}: no mesh; run the case stage first")
    state = {"ranks": ranks.count, "mesh": points.stat().st_mtime_ns}
    return state | ({"collated": True} if ranks.collated else {})


def prepared_for(case: Path) -> dict[str, int]:
    """What `case` was last prepared for; empty where it never was. StageError where the file is damaged."""
    path = case / STATE
    return read_json(path, f"delete it and run make again: {case.name} begins anew") if path.exists() else {}


def prepare(
    scene: Scene, intervals: tuple[Interval, ...], interval: Interval, ranks: Ranks, quiet: bool
) -> None:
    """Decompose an interval's case, carry the flow over and lay the frames, unless that was done for the same mesh and ranks."""
    case = scene.out / "case" / interval.name
    wanted = case_state(case, ranks)
    if prepared_for(case) == wanted:
        return
    # what is interrupted from here on must begin anew, and so what follows
    for later in reversed(intervals[interval.index :]):
        for stale in (STATE, PROGRESS):
            (scene.out / "case" / later.name / stale).unlink(missing_ok=True)
    first = time_name(interval.begin(scene.numerics.time_step))
    for folder in case.glob("processor*"):
        shutil.rmtree(folder)
    for folder in case.iterdir():
        if folder.is_dir() and re.fullmatch(r"[0-9.e-]+", folder.name) and folder.name != "0":
            shutil.rmtree(folder)
    shutil.rmtree(case / "postProcessing", ignore_errors=True)
    set_number(case, "startTime", first)
    if interval.index:
        map_fields(scene, intervals[interval.index - 1], interval, ranks)
    sweep = read_sweep(scene.out, interval.name)
    planform = read_planform(scene.out, interval.mesh)
    if ranks.count > 1:
        _decompose(case, sweep, planform, ranks)
    if interval.moving:
        _lay_frames(scene, interval, sweep, planform, ranks, quiet)
    write_text(case / STATE, json.dumps(wanted))


def _lay_frames(
    scene: Scene, interval: Interval, sweep: xr.Dataset, planform: xr.Dataset, ranks: Ranks, quiet: bool
) -> None:
    case, step = scene.out / "case" / interval.name, scene.numerics.time_step
    node, level = sweep["node"].values, sweep["level"].values
    kind, top = scene.model.kind, planform.sizes["level"] - 1
    driving = (level == 0) | ((level == top) if kind == "full" else False)
    points = [np.arange(len(node))]
    if ranks.count > 1:
        points = [labels_of(block) for block in ranks.contents(case, "constant/polyMesh/pointProcAddressing")]
    first_step, last_step = steps_of(interval.begin(step), step), steps_of(interval.end, step)
    done = write_frames(
        ranks.folders(case), read_motion(scene.out, interval.mesh), [node[p] for p in points], [driving[p] for p in points],
        step, first_step, last_step, flat=kind == "2d", collated=ranks.collated,
    )  # fmt: skip
    for _ in tqdm(done, desc="frames", total=last_step - first_step + PADDING + 1, disable=quiet or None):
        pass


def _decompose(case: Path, sweep: xr.Dataset, planform: xr.Dataset, ranks: Ranks) -> None:
    column = sweep["cell_column"].values
    triangles, quads = planform["triangles"].values, planform["quads"].values
    centres = cell_centres(planform["points"].values[0], triangles, quads)
    load = np.bincount(column, minlength=len(centres)).astype(float)
    rank = partition_columns(centres, load, ranks.count, neighbours(planform_edges(triangles, quads)))[column]
    write_list(case / "constant" / "cellDecomposition", "labelList", "constant", rank)
    set_number(case, "numberOfSubdomains", str(ranks.count), "decomposeParDict")
    files = COLLATED if ranks.collated else ()
    run_tool(["decomposePar", "-force", "-noFunctionObjects", *files], case, "log.decomposePar")
