"""Reading what a scene is judged by: its planes and vortices, the clock of its motion, and the single finger beside a pinch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import xarray as xr

from fileio.formats.kinematics import read_kinematics
from fileio.formats.plane_series import read_plane
from pipeline.scene.scene import Scene
from postprocess.evidence import fields
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.centreline import centreline
from postprocess.evidence.check_finite import check_finger
from postprocess.evidence.evidence import Evidence
from postprocess.evidence.half_planes import half_planes
from postprocess.evidence.pair_integrals import pair_integrals
from postprocess.evidence.stage_files import StageFiles
from postprocess.evidence.strokes import peak_tip_speed, progress
from postprocess.evidence.time_windows import Clock
from postprocess.evidence.vortex_pairs import pair_vortices

FILES = {"cfd": "sheet.h5", "piv": "piv.h5"}
FINGER = {"tip", "bend", "outline"}


def load_evidence(files: StageFiles, single_level: str | None = None) -> Evidence:
    """Open what was run: the CFD (required) and the PIV (optional); sums over their common region; of two fingers their pairs.

    `single_level`: level at which the single finger is looked for beside a pinch (default: that of `files`).
    """
    planes = {"cfd": read_plane(files.required("sheet.h5", "sheet"))}
    vortices = {"cfd": tracks.read_vortices(files.required("vortices_cfd.csv", "vortices"))}
    piv = files.optional("piv.h5")
    if piv is not None:
        planes["piv"] = read_plane(piv)
        vortices["piv"] = tracks.read_vortices(files.required("vortices_piv.csv", "vortices"))
    missing = sorted(FINGER - set(planes["cfd"]))
    if missing:
        raise ValueError(
            f"{files.out / 'sheet.h5'}: variable {missing[0]!r} is missing; run the stage 'sheet' again"
        )
    for source, plane in planes.items():
        check_finger(plane, FINGER & set(plane), files.out / FILES[source])
    scale, _ = peak_tip_speed(planes["cfd"]["time"].values, planes["cfd"]["tip"].values)
    sums = {"piv-cfd": fields.field_sums(planes["cfd"], planes["piv"])} if piv is not None else {}
    clock = read_clock(files.numbers, planes["cfd"])
    evidence = Evidence(planes, vortices, scale, clock, sums)
    if planes["cfd"].sizes["finger"] < 2:
        return evidence
    pairs = {source: pair_vortices(table) for source, table in vortices.items()}
    lines = {source: centreline(plane, scale) for source, plane in planes.items()}
    integrals = {source: pair_integrals(plane, scale) for source, plane in planes.items()}
    halves = {source: half_planes(plane) for source, plane in planes.items()}
    single, absent = single_finger(files.numbers, single_level or files.level)
    evidence = replace(evidence, pairs=pairs, lines=lines, integrals=integrals, halves=halves)
    return replace(evidence, single=single, single_absent=absent)


def single_finger(pinch: Scene, level: str) -> tuple[dict[str, pd.DataFrame], str]:
    """Vortices of the single finger that the scene of a pinch extends, by source, with its `bend` (rad); why there are none."""
    if not pinch.parents:
        return {}, "the scene extends no scene of a single finger, so nothing is compared with one"
    folder = pinch.parents[-1]
    beside = folder / "out" / level
    sheet = beside / "sheet.h5"
    tables = {}
    for source in ("cfd", "piv"):
        path = beside / f"vortices_{source}.csv"
        if path.exists() and sheet.exists():
            table = tracks.read_vortices(path)
            with read_plane(sheet) as plane:
                bend = np.interp(table["time"], plane["time"].values, plane["bend"].values[:, 0])
            tables[source] = table.assign(bend=bend)
    run = f"make {folder.name} LEVEL={level}"
    if tables:
        return (
            tables,
            f"no PIV of the single finger at level {level} was made, so PIV is not compared with it: {run}",
        )
    return (
        tables,
        f"the single finger at level {level} was not run, so nothing is compared with it: {run}",
    )


def read_clock(scene: Scene, plane: xr.Dataset) -> Clock:
    """What windows of time are defined by: the stroke's progress on the sheet, gap and strokes."""
    time, done = plane["time"].values, progress(plane)
    kinematics = read_kinematics(scene.out / "kinematics.h5")
    starts = tuple(float(stroke.start) for stroke in scene.motion.strokes)
    gap = kinematics.values("gap")
    if gap is None:
        return Clock(time, done, starts=starts)
    residual = float(kinematics.data.attrs["residual_gap"])
    return Clock(time, done, kinematics.law.x, gap, residual, starts)
