"""All pictures of the report: figures/*.png|svg, the frames of the slider, the film, and their index figures.json."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fileio.formats.mesh_intervals import read_planforms
from fileio.formats.plane_series import read_plane
from fileio.formats.records import COMPARISON, FIGURES
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.load import read_clock, single_finger
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.report.flow_figures import flow_figures, tip_vortices, vortex_figures
from postprocess.report.motion_figures import bending_figure, motion_figure, study_figures, water_figure
from postprocess.report.picture_index import Album
from postprocess.report.pinch_figures import pinch_figures
from postprocess.report.run_figures import camera_picture, mesh_figures, solver_figures

REQUIRED = (
    ("sheet.h5", "sheet"),
    ("vortices_cfd.csv", "vortices"),
    ("comparison.json", "compare"),
    ("comparison.csv", "compare"),
    ("kinematics.h5", "kinematics"),
    ("planform.h5", "mesh"),
    ("sweep.h5", "case"),
    ("mesh_quality.csv", "mesh"),
    ("run/run.json", "run"),
    ("run/forces.csv", "run"),
    ("run/power.csv", "run"),
    ("run/power_terms.csv", "run"),
    ("run/history.csv", "run"),
)


def make_figures(files: StageFiles) -> list[dict[str, Any]]:
    """Draw everything for one scene and level; returns the index that figures.json holds."""
    for name, stage in REQUIRED:  # before minutes of drawing, not after
        files.required(name, stage)
    out, scene = files.out, scene_numbers(files)
    comparison = COMPARISON.read(out / "comparison.json")
    scale = comparison["scale"]["value"]
    start, end = comparison["middle_of_stroke_s"]
    middle = (float(start), float(end))
    planes = {"cfd": read_plane(out / "sheet.h5")}
    tables = {"cfd": tracks.read_vortices(out / "vortices_cfd.csv")}
    if files.optional("piv.h5") is not None:
        planes["piv"] = read_plane(out / "piv.h5")
        tables["piv"] = tracks.read_vortices(files.required("vortices_piv.csv", "vortices"))
    clock = read_clock(out / "kinematics.h5", planes["cfd"])
    dominant = tip_vortices(planes["cfd"], tables, middle)
    album = Album(files.figures)
    flow_figures(album, planes, tables, dominant, scale, clock)
    vortex_figures(album, pd.read_csv(out / "comparison.csv"), planes["cfd"], dominant, middle, scale)
    if planes["cfd"].sizes["finger"] > 1:
        single, absent = single_finger(files.scene_folder, files.level)
        pinch_figures(album, out, planes["cfd"], clock, comparison["summary"]["pinch"], single, absent, scale)
    rigid = scene.get("body") is not None
    motion_figure(album, out / "kinematics.h5", planes["cfd"], rigid)
    if not rigid:
        bending_figure(album, out / "kinematics.h5", scene["finger"]["length"])
        if (out / "loads.h5").exists():
            water_figure(album, out / "loads.h5")
        study_figures(album, files.scene_folder, scene["motion"])
    solver_figures(album, out)
    width, tank = scene["finger"]["width"], scene["tank"]["size"]
    mesh_figures(album, read_planforms(out / "planform.h5"), planes["cfd"], width, tank)
    if (out / "images.h5").exists():
        camera_picture(album, out / "images.h5", float(np.mean(middle)))
    for plane in planes.values():
        plane.close()
    FIGURES.write(files.figures / "figures.json", {"entries": album.entries})
    return album.entries


def run(scene_folder: Path, level: str, quiet: bool = False) -> None:
    """Stage figures."""
    files = StageFiles(scene_folder, level)
    entries = make_figures(files)
    if not quiet:
        print(f"{len(entries)} pictures in {files.figures}")
