"""Stage figures: the report's pictures, slider and film, and their index figures.json."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from itertools import chain, islice
from typing import Any

import numpy as np
import pandas as pd

from fileio.child_process import worker_pool
from fileio.formats.finger_loads import deflection_sentence, read_loads
from fileio.formats.mesh_intervals import read_planforms
from fileio.formats.records import COMPARISON, FIGURES
from pipeline.scene.scene import Scene
from postprocess.evidence.load import read_clock, read_sources, single_finger
from postprocess.evidence.stage_files import StageFiles, scene_numbers
from postprocess.report.flow_figures import (
    Flow,
    film,
    film_frames,
    instant_figures,
    tip_vortices,
    vortex_figures,
)
from postprocess.report.motion_figures import bending_figure, motion_figure, water_figure
from postprocess.report.picture_index import Album
from postprocess.report.pinch_figures import pinch_figures
from postprocess.report.run_figures import camera_picture, mesh_figures, solver_figures

_REQUIRED = {
    "sheet.h5": "sheet",
    "vortices_cfd.csv": "vortices",
    "comparison.json": "compare",
    "comparison.csv": "compare",
    "kinematics.h5": "kinematics",
    "planform.h5": "mesh",
    "sweep.h5": "case",
    "mesh_quality.csv": "mesh",
    "run/run.json": "run",
    "run/forces.csv": "run",
    "run/power.csv": "run",
    "run/power_terms.csv": "run",
    "run/history.csv": "run",
}
_Job = Callable[[], list]


def make_figures(files: StageFiles, threads: int = 1) -> list[dict[str, Any]]:
    """Draw everything for one scene and level by `threads` processes; returns the index."""
    for name, stage in _REQUIRED.items():  # before minutes of drawing, not after
        files.required(name, stage)
    scene, album = scene_numbers(files), Album(files.figures)
    loads = files.optional("loads.h5")
    with _evidence(files) as (flow, _):
        tip_height = float(flow.planes["cfd"]["tip"].values[..., 1].max())
        chunks = np.array_split(flow.film_times(), threads)
        jobs: list[_Job] = [
            partial(_other_figures, files, scene),
            *(partial(_film_frames, files, times) for times in chunks),
            partial(_instant_figures, files),
        ]
        with worker_pool(threads, forked=True) if threads > 1 else nullcontext() as pool:
            results = (pool.map if pool else map)(_result, jobs)
            others = next(results)
            film(album, flow, chain.from_iterable(islice(results, threads)))
            entries = [*next(results), *album.entries, *others]
    content = {
        "entries": entries,
        "tip_height": tip_height,
        "deflection": deflection_sentence(read_loads(loads).attrs) if loads else "",
    }
    FIGURES.write(files.figures / "figures.json", content)
    return entries


def _result(job: _Job) -> list:
    return job()


@contextmanager
def _evidence(files: StageFiles) -> Iterator[tuple[Flow, dict[str, Any]]]:
    """The flow that is drawn, and the comparison; each process reads them by itself."""
    comparison = COMPARISON.read(files.out / "comparison.json")
    planes, tables = read_sources(files)
    try:
        clock = read_clock(files.numbers, planes["cfd"])
        dominant = tip_vortices(planes["cfd"], tables, comparison["middle_of_stroke_s"])
        yield Flow(planes, tables, dominant, comparison["scale"]["value"], clock), comparison
    finally:
        for plane in planes.values():
            plane.close()


def _instant_figures(files: StageFiles) -> list[dict[str, Any]]:
    album = Album(files.figures)
    with _evidence(files) as (flow, _):
        instant_figures(album, flow)
    return album.entries


def _film_frames(files: StageFiles, times: np.ndarray) -> list[np.ndarray]:
    with _evidence(files) as (flow, _):
        return film_frames(flow, times)


def _other_figures(files: StageFiles, scene: dict[str, Any]) -> list[dict[str, Any]]:
    out, album = files.out, Album(files.figures)
    with _evidence(files) as (flow, comparison):
        plane, middle = flow.planes["cfd"], comparison["middle_of_stroke_s"]
        vortex_figures(album, pd.read_csv(out / "comparison.csv"), flow, middle)
        if plane.sizes["finger"] > 1:
            single, absent = single_finger(files.numbers)
            pinch_figures(album, out, flow, comparison["summary"]["pinch"], single, absent)
        rigid = scene.get("body") is not None
        motion_figure(album, out / "kinematics.h5", plane, rigid)
        if not rigid:
            bending_figure(album, out / "kinematics.h5", scene["finger"]["length"])
            if (out / "loads.h5").exists():
                water_figure(album, out / "loads.h5")
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
