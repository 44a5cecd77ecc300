"""All pictures of the report: figures/*.png|svg, the frames of the slider, the film, and their index figures.json."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from functools import partial
from itertools import chain, islice
from typing import Any

import numpy as np
import pandas as pd

from fileio.child_process import worker_pool
from fileio.formats.mesh_intervals import read_planforms
from fileio.formats.plane_series import read_plane
from fileio.formats.records import COMPARISON, FIGURES
from pipeline.scene.scene import Scene
from postprocess.evidence import tip_vortex as tracks
from postprocess.evidence.load import read_clock, single_finger
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.report.flow_figures import (
    Flow,
    film,
    film_frames,
    instant_figures,
    tip_vortices,
    vortex_figures,
)
from postprocess.report.motion_figures import (
    bending_figure,
    motion_figure,
    study_figures,
    water_figure,
)
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

Job = Callable[[], list]


def make_figures(files: StageFiles, threads: int = 1) -> list[dict[str, Any]]:
    """Draw everything for one scene and level, by `threads` processes; returns the index that figures.json holds."""
    for name, stage in REQUIRED:  # before minutes of drawing, not after
        files.required(name, stage)
    album = Album(files.figures)
    with _evidence(files) as (flow, _):
        chunks = np.array_split(flow.film_times(), threads)
        film_jobs = [partial(_film_frames, files, times) for times in chunks]
        jobs: list[Job] = [
            partial(_other_figures, files),
            *film_jobs,
            partial(_instant_figures, files),
        ]
        with worker_pool(threads, forked=True) if threads > 1 else nullcontext() as pool:
            results = (pool.map if pool else map)(_result, jobs)
            others = next(results)
            film(album, flow, chain.from_iterable(islice(results, threads)))
            entries = [*next(results), *album.entries, *others]
    FIGURES.write(files.figures / "figures.json", {"entries": entries})
    return entries


def _result(job: Job) -> list:
    return job()


@contextmanager
def _evidence(files: StageFiles) -> Iterator[tuple[Flow, dict[str, Any]]]:
    """What the flow is drawn of, and the comparison: each process reads it by itself."""
    out = files.out
    comparison = COMPARISON.read(out / "comparison.json")
    with ExitStack() as opened:
        planes = {"cfd": opened.enter_context(read_plane(out / "sheet.h5"))}
        tables = {"cfd": tracks.read_vortices(out / "vortices_cfd.csv")}
        if files.optional("piv.h5") is not None:
            planes["piv"] = opened.enter_context(read_plane(out / "piv.h5"))
            tables["piv"] = tracks.read_vortices(files.required("vortices_piv.csv", "vortices"))
        clock = read_clock(files.numbers, planes["cfd"])
        dominant = tip_vortices(planes["cfd"], tables, _middle(comparison))
        yield Flow(planes, tables, dominant, comparison["scale"]["value"], clock), comparison


def _middle(comparison: dict[str, Any]) -> tuple[float, float]:
    start, end = comparison["middle_of_stroke_s"]
    return float(start), float(end)


def _instant_figures(files: StageFiles) -> list[dict[str, Any]]:
    album = Album(files.figures)
    with _evidence(files) as (flow, _):
        instant_figures(album, flow)
    return album.entries


def _film_frames(files: StageFiles, times: np.ndarray) -> list[np.ndarray]:
    with _evidence(files) as (flow, _):
        return film_frames(flow, times)


def _other_figures(files: StageFiles) -> list[dict[str, Any]]:
    out, scene, album = files.out, scene_numbers(files), Album(files.figures)
    with _evidence(files) as (flow, comparison):
        plane, scale, middle = flow.planes["cfd"], flow.scale, _middle(comparison)
        vortex_figures(
            album, pd.read_csv(out / "comparison.csv"), plane, flow.dominant, middle, scale
        )
        if plane.sizes["finger"] > 1:
            single, absent = single_finger(files.numbers, files.level)
            pair = comparison["summary"]["pinch"]
            pinch_figures(album, out, plane, flow.clock, pair, single, absent, scale)
        rigid = scene.get("body") is not None
        motion_figure(album, out / "kinematics.h5", plane, rigid)
        if not rigid:
            bending_figure(album, out / "kinematics.h5", scene["finger"]["length"])
            if (out / "loads.h5").exists():
                water_figure(album, out / "loads.h5")
            study_figures(album, files.scene_folder, scene["motion"])
        solver_figures(album, out)
        width, tank = scene["finger"]["width"], scene["tank"]["size"]
        mesh_figures(album, read_planforms(out / "planform.h5"), plane, width, tank)
        if (out / "images.h5").exists():
            camera_picture(album, out / "images.h5", float(np.mean(middle)))
    return album.entries


def run(scene: Scene, quiet: bool = False, threads: int = 1) -> None:
    """Stage figures."""
    files = StageFiles(scene)
    entries = make_figures(files, threads)
    if not quiet:
        print(f"{len(entries)} pictures in {files.figures}")
