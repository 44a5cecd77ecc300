"""All pictures of the report: figures/*.png|svg, the frames of the slider, the film, and their index figures.json.

Command: python -m postprocess.report.figures cases/single_finger --level coarse
"""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np

from fileio.atomic import write_text
from fileio.formats.plane_series import read_plane
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.load import read_clock
from postprocess.evidence.stage_command import run_stage
from postprocess.evidence.stage_files import StageFiles, read_json
from postprocess.report.flow_figures import flow_figures, tip_vortices, vortex_figures
from postprocess.report.motion_figures import bending_figure, motion_figure, study_figures
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
    ("run/history.csv", "run"),
)


def make_figures(files: StageFiles) -> list[dict[str, Any]]:
    """Draw everything for one scene and level; returns the index that figures.json holds."""
    for name, stage in REQUIRED:  # before minutes of drawing, not after
        files.required(name, stage)
    comparison = read_json(files.out / "comparison.json")
    start, end = comparison["middle_of_stroke_s"]
    middle = (float(start), float(end))
    planes = {"cfd": read_plane(files.out / "sheet.h5")}
    tables = {"cfd": tracks.read_vortices(files.out / "vortices_cfd.csv")}
    if files.optional("piv.h5") is not None:
        planes["piv"] = read_plane(files.out / "piv.h5")
        tables["piv"] = tracks.read_vortices(files.required("vortices_piv.csv", "vortices"))
    clock = read_clock(files, planes["cfd"])
    dominant = tip_vortices(planes["cfd"], tables, middle)
    album = Album(files.figures)
    flow_figures(album, planes, dominant, comparison["scale"]["value"], clock)
    vortex_figures(album, files, planes["cfd"], dominant, middle, comparison["scale"]["value"])
    if planes["cfd"].sizes["finger"] > 1:
        pinch_figures(album, files, planes["cfd"], clock, comparison["summary"]["pinch"])
    motion_figure(album, files, planes["cfd"])
    bending_figure(album, files)
    study_figures(album)
    solver_figures(album, files)
    mesh_figures(album, files, planes["cfd"])
    camera_picture(album, files, float(np.mean(middle)))
    for plane in planes.values():
        plane.close()
    write_text(files.figures / "figures.json", json.dumps(album.entries, indent=1, default=float))
    return album.entries


def _tell(files: StageFiles, entries: list[dict[str, Any]]) -> None:
    print(f"{len(entries)} pictures in {files.figures}")


def main(argv: list[str] | None = None) -> int:
    """Command line; returns 0 good, 2 bad input."""
    return run_stage("figures", __doc__, make_figures, _tell, argv)


if __name__ == "__main__":
    sys.exit(main())
