"""Reading the evidence of a scene: planes, vortices, clock, and the single finger of a pinch."""

from dataclasses import replace

import numpy as np
import pandas as pd
import xarray as xr

from pipeline.formats.kinematics import read_kinematics
from pipeline.runs.run import open_run, single_finger_out
from pipeline.scene.scene import Scene
from piv.formats.plane_series import read_plane
from postprocess.evidence import fields
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.centreline import centreline
from postprocess.evidence.evidence import Evidence
from postprocess.evidence.pair_integrals import pair_integrals
from postprocess.evidence.stage_files import StageFiles
from postprocess.evidence.strokes import peak_tip_speed, progress
from postprocess.evidence.time_windows import Clock
from postprocess.evidence.vortex_pairs import pair_vortices

FILES = {"cfd": "sheet.h5", "piv": "piv.h5"}


def read_sources(files: StageFiles) -> tuple[dict[str, xr.Dataset], dict[str, pd.DataFrame]]:
    """Planes and vortex tables of the CFD, and of the PIV where it was run."""
    planes = {"cfd": read_plane(files.required("sheet.h5", "sheet"))}
    if piv := files.optional("piv.h5"):
        planes["piv"] = read_plane(piv)
    tables = {
        source: tracks.read_vortices(files.required(f"vortices_{source}.csv", "vortices"))
        for source in planes
    }
    return planes, tables


def load_evidence(files: StageFiles) -> Evidence:
    """What was run, with the velocity sums of CFD and PIV, and of two fingers their pairs."""
    planes, vortices = read_sources(files)
    cfd = planes["cfd"]
    scale, _ = peak_tip_speed(cfd["time"].values, cfd["tip"].values)
    sums = {"piv-cfd": fields.field_sums(cfd, planes["piv"])} if "piv" in planes else {}
    clock = read_clock(files.numbers, cfd)
    # it takes the place of the middle of the stroke, and is no shorter
    least = float(np.ptp(clock.middle()))
    clock = replace(clock, known=tracks.known_window(vortices, clock.stroke(), least))
    evidence = Evidence(planes, vortices, scale, clock, sums)
    if cfd.sizes["finger"] < 2:
        return evidence
    single, absent = single_finger(files.numbers)
    return replace(
        evidence,
        pairs={source: pair_vortices(table, clock.closing()) for source, table in vortices.items()},
        lines={source: centreline(plane, scale) for source, plane in planes.items()},
        integrals={
            source: pair_integrals(plane, vortices[source]) for source, plane in planes.items()
        },
        single=single,
        single_absent=absent,
    )


def single_finger(pinch: Scene) -> tuple[dict[str, pd.DataFrame], str]:
    """Vortices by source of the single finger that a pinch extends, with its `bend` (rad).

    It is moved as the pinch is: by a law, or coupled. The second is the sentence that says why
    there are none, or none of PIV.
    """
    if not pinch.parents:
        return {}, "the scene extends no scene of a single finger, so nothing is compared with one"
    folder, level = pinch.parents[-1], pinch.level
    moved = {"motion.source": "structure"} if pinch.coupled else {}
    alone = open_run(folder, level, moved, single_finger_out(pinch))
    tables = {}
    for source in FILES:
        # a stale table is that of another motion
        if not alone.why_stale(f"vortices_{source}") and not alone.why_stale("sheet"):
            table = tracks.read_vortices(alone.path(f"vortices_{source}"))
            with read_plane(alone.path("sheet")) as plane:
                bend = np.interp(table["time"], plane["time"].values, plane["bend"].values[:, 0])
            tables[source] = table.assign(bend=bend)
    absent = (
        f"no PIV of the single finger at level {level} is made, so PIV is not compared with it"
        if tables
        else f"the single finger at level {level} was not run as it is, so nothing is compared"
        " with it"
    )
    command = f"make {folder.name} LEVEL={level}{' COUPLED=1' * pinch.coupled}"
    return tables, f"{absent}: {command}"


def read_clock(scene: Scene, plane: xr.Dataset) -> Clock:
    """The stroke's progress on the sheet, the gap of kinematics.h5, and the scene's strokes."""
    time, done = plane["time"].values, progress(plane)
    kinematics = read_kinematics(scene.motion_folder / "kinematics.h5")
    starts = tuple(float(stroke.start) for stroke in scene.motion.strokes)
    gap = kinematics.values("gap")
    if gap is None:
        return Clock(time, done, starts=starts)
    residual = float(kinematics.data.attrs["residual_gap"])
    return Clock(time, done, kinematics.law.x, gap, residual, starts)
