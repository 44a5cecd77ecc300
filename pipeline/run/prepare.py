"""Preparation of an interval's case: decomposition, mapped fields, files of the motion."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from tqdm import tqdm

from fileio.atomic import write_text
from fileio.errors import StageError
from fileio.formats.mesh_intervals import Interval, read_planform
from fileio.formats.node_motion import read_motion
from fileio.formats.sweep import read_sweep
from fileio.json_text import read_json
from fileio.record import check_whole
from pipeline.geometry.quality import cell_centres, neighbours, planform_edges
from pipeline.openfoam.displacement_files import Steps, frames_laid, time_name, write_frames
from pipeline.openfoam.environment import COLLATED, foam_version, run_tool
from pipeline.openfoam.foamfile import labels_of, write_list
from pipeline.openfoam.ranks import Ranks
from pipeline.run.map_fields import map_fields
from pipeline.run.partition import partition_columns
from pipeline.run.solver import PROGRESS, has_ended, set_number

STATE = "state.json"  # the mesh, ranks and OpenFOAM for which an interval's folder was prepared


def case_state(case: Path, ranks: Ranks) -> dict[str, Any]:
    """The mesh (time of its file), ranks and OpenFOAM to which the files in `case` belong."""
    points = case / "constant" / "polyMesh" / "points"
    if not points.exists():
        raise StageError(f"{case}: no mesh; run the case stage first")
    state = {"ranks": ranks.count, "mesh": points.stat().st_mtime_ns, "version": foam_version()}
    return state | ({"collated": True} if ranks.collated else {})


def prepared_for(case: Path) -> dict[str, Any]:
    """The state for which `case` was last prepared, or {}. StageError where the file is damaged."""
    path, remedy = case / STATE, "delete it and run make again"
    if not path.exists():
        return {}
    return read_json(path, f"{remedy}: {case.name} is solved from its beginning")


def prepared_ranks(case: Path) -> Ranks:
    """The ranks for which `case` was last prepared; one where it never was."""
    state = prepared_for(case)
    return Ranks(state.get("ranks", 1), bool(state.get("collated", False)))


def prepare(
    out: Path, intervals: tuple[Interval, ...], interval: Interval, ranks: Ranks, steps: Steps,
    quiet: bool,
) -> None:  # fmt: skip
    """Decompose an interval's case, map its first fields and write its motion, unless done.

    `out`: the level's folder. Done counts only for the same mesh, ranks and version of OpenFOAM.
    """
    case = out / "case" / interval.name
    wanted = case_state(case, ranks)
    for path in (case / "constant" / "polyMesh").iterdir():
        check_whole(path, f"delete {out / 'sweep.h5'} and run make again")
    done = prepared_for(case) == wanted
    # the frames are removed after an interval: one that is solved again needs them
    if done and (has_ended(case, interval) or frames_laid(ranks.folders(case)[0])):
        return
    planform, sweep = read_planform(out, interval.mesh), read_sweep(out, interval.name)
    if not done:
        # interrupted from here on, this interval and those after it start from the beginning
        for later in reversed(intervals[interval.index :]):
            for stale in (STATE, PROGRESS):
                (out / "case" / later.name / stale).unlink(missing_ok=True)
        for folder in case.iterdir():
            time = re.fullmatch(r"[0-9.e-]+", folder.name) and folder.name != "0"
            if folder.is_dir() and (
                time or folder.name.startswith(("processor", "postProcessing"))
            ):
                shutil.rmtree(folder)
        set_number(case, "startTime", time_name(interval.begin))
        if interval.index:
            map_fields(out, intervals[interval.index - 1], interval, ranks, steps.first)
        if ranks.count > 1:
            _decompose(case, sweep, planform, ranks)
    if interval.moving:
        node, level = sweep["node"].values, sweep["level"].values
        kind = planform.attrs["model"]
        driving = (level == 0) | ((level == planform.sizes["level"] - 1) & (kind == "full"))
        points = [np.arange(len(node))]
        if ranks.count > 1:
            addressing = ranks.contents(case, "constant/polyMesh/pointProcAddressing")
            points = [labels_of(block) for block in addressing]
        frames = write_frames(
            ranks.folders(case), read_motion(out, interval.mesh), [node[p] for p in points],
            [driving[p] for p in points], steps.times, kind == "2d", ranks.collated,
        )  # fmt: skip
        for _ in tqdm(frames, desc="frames", total=len(steps.times), disable=quiet or None):
            pass
    if not done:
        write_text(case / STATE, json.dumps(wanted))


def _decompose(case: Path, sweep: xr.Dataset, planform: xr.Dataset, ranks: Ranks) -> None:
    column = sweep["cell_column"].values
    triangles, quads = planform["triangles"].values, planform["quads"].values
    centres = cell_centres(planform["points"].values[0], triangles, quads)
    load = np.bincount(column, minlength=len(centres)).astype(float)
    rank = partition_columns(
        centres, load, ranks.count, neighbours(planform_edges(triangles, quads))
    )[column]
    write_list(case / "constant" / "cellDecomposition", "labelList", "constant", rank)
    set_number(case, "numberOfSubdomains", str(ranks.count), "decomposeParDict")
    files = COLLATED if ranks.collated else ()
    run_tool(["decomposePar", "-force", "-noFunctionObjects", *files], case, "log.decomposePar")
