"""Reading what a scene is judged by: its planes and vortices, the clock of its motion, and the single finger beside a pinch."""

from __future__ import annotations

import tomllib
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import xarray as xr

from fileio.formats.plane_series import read_plane
from fileio.provenance import settings_in
from postprocess.evidence import fields
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.centreline import centreline
from postprocess.evidence.check_finite import check_finger
from postprocess.evidence.evidence import Evidence
from postprocess.evidence.stage_files import StageFiles
from postprocess.evidence.strokes import peak_tip_speed
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
    starts = read_clock(files, planes["cfd"]).starts
    if planes["cfd"].sizes["finger"] < 2:
        return Evidence(planes, vortices, scale, sums, starts=starts)
    single, absent = single_finger(files, single_level or files.level)
    return Evidence(
        planes,
        vortices,
        scale,
        sums,
        pairs={source: pair_vortices(table) for source, table in vortices.items()},
        lines={source: centreline(plane, scale) for source, plane in planes.items()},
        single=single,
        single_absent=absent,
        starts=starts,
    )


def single_finger(files: StageFiles, level: str) -> tuple[dict[str, pd.DataFrame], str]:
    """Vortices of the single finger that a pinch extends, by source, with its `bend` (rad); and what to run where there are none."""
    case = extended(files.case)
    beside = StageFiles(case, level)
    sheet = beside.optional("sheet.h5")
    found = {}
    for source in ("cfd", "piv"):
        path = beside.optional(f"vortices_{source}.csv")
        if path is not None and sheet is not None:
            table = tracks.read_vortices(path)
            with read_plane(sheet) as plane:
                bend = np.interp(table["time"], plane["time"].values, plane["bend"].values[:, 0])
            found[source] = table.assign(bend=bend)
    absent = f"the single finger at level {level} was not run, so nothing is compared with it: make {beside.scene} LEVEL={level}"
    return found, absent


def extended(case: Path) -> Path:
    """The scene at the end of the chain of `extends` that begins at a scene's folder."""
    table = tomllib.loads((case / "scene.toml").read_text(encoding="utf-8"))
    return extended(case / table["extends"]) if "extends" in table else case


def read_clock(files: StageFiles, plane: xr.Dataset, finger: int = 0) -> Clock:
    """What windows are told by: the sheet's bend, and the gap and the strokes of kinematics.h5."""
    time, bend = plane["time"].values, plane["bend"].values[:, finger]
    path = files.required("kinematics.h5", "kinematics")
    with h5py.File(path, "r") as file:
        strokes = settings_in(file, path).get("motion", {}).get("strokes", [])
        starts = tuple(float(stroke["start"]) for stroke in strokes)
        if "gap" not in file:
            return Clock(time, bend, starts=starts)
        residual = float(np.ravel(file.attrs["residual_gap"])[0])
        return Clock(time, bend, file["time"][:], file["gap"][:], residual, starts)
