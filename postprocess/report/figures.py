"""Stage figures: the report's pictures, slider and film, and their index figures.json."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from itertools import chain
from operator import call
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pipeline.formats.finger_loads import motion_sentence, read_loads
from pipeline.formats.mesh_intervals import read_planforms
from pipeline.formats.records import COMPARISON, FIGURES
from pipeline.scene.scene import Scene
from piv.files.child_process import read_in_child, worker_pool
from piv.formats.plane_series import read_plane
from postprocess.evidence.load import read_clock, read_sources
from postprocess.evidence.stage_files import StageFiles
from postprocess.report.flow_figures import Flow, instant_figures, slider_frames, tip_vortices
from postprocess.report.motion_figures import bending_figure, water_figure
from postprocess.report.picture_index import Album, PrintAlbum
from postprocess.report.pinch_figures import pinch_figures
from postprocess.report.pressure_figures import pressure_figure
from postprocess.report.run_figures import camera_picture, energy_figure, mesh_figures
from postprocess.report.space_figures import space_figures
from postprocess.report.time_figures import series, timeline, vortex_figures
from postprocess.tables import write_table

_Job = Callable[[], list]


def make_figures(files: StageFiles, threads: int = 1) -> list[dict[str, Any]]:
    """Draw everything for one scene and level by `threads` processes; returns the index."""
    loads = files.optional("loads.h5")
    shown = ["cfd", "piv", "difference"] if files.optional("piv.h5") else ["cfd"]
    jobs: list[_Job] = [partial(_draw, files, draw) for draw in (_space, _others, instant_figures)]
    jobs += [partial(_draw, files, partial(slider_frames, source=source)) for source in shown]
    with worker_pool(threads, forked=True) if threads > 1 else nullcontext() as pool:
        entries = list(chain.from_iterable((pool.map if pool else map)(call, jobs)))
    with _flow(files) as flow:
        tip = flow.planes["cfd"]["tip"].values[:, 0]
    known: dict[str, Any] = {}
    if loads:
        file = read_loads(loads)
        known = dict(file.attrs) | {str(name): file[name].values for name in file.variables}
    content = {
        "entries": entries,
        "tip_height": float(tip[:, 1].max()),
        "tip_way": float(np.linalg.norm(np.diff(tip, axis=0), axis=1).sum()),
        "motion": motion_sentence(known) if known else "",
    }
    FIGURES.write(files.figures / "figures.json", content)
    return entries


@contextmanager
def _flow(files: StageFiles) -> Iterator[Flow]:
    """The flow that is drawn; each process reads it by itself."""
    comparison = COMPARISON.read(files.out / "comparison.json")
    judged, scale = comparison["judged_s"], comparison["scale"]["value"]
    planes, tables = read_sources(files)
    try:
        clock = read_clock(files.numbers, planes["cfd"])
        dominant = tip_vortices(planes["cfd"], tables, clock, judged)
        yield Flow(files, planes, tables, dominant, scale, clock, judged)
    finally:
        for plane in planes.values():
            plane.close()


def _draw(files: StageFiles, draw: Callable[[Album, Flow], None]) -> list[dict[str, Any]]:
    album = Album(files.figures)
    with _flow(files) as flow:
        draw(album, flow)
    return album.entries


def _space(album: Album, flow: Flow) -> None:
    """In a process of its own: without a library to draw off-screen, VTK ends the process."""
    try:
        album.entries += read_in_child(space_figures, album.folder, flow)
    except ChildProcessError:
        print(
            "No picture in space: VTK cannot draw without a screen here; install libegl1 and"
            " libgl1-mesa-dri (apt), then make the report again"
        )


def _others(album: Album, flow: Flow) -> None:
    motion = flow.files.numbers.motion_folder
    out, plane, at = flow.files.out, flow.planes["cfd"], float(np.mean(flow.judged))
    timeline(album, flow)
    vortex_figures(album, flow)
    if plane.sizes["finger"] > 1:
        pinch_figures(album, flow)
    if flow.files.numbers.body is None:
        bending_figure(album, motion / "kinematics.h5")
        if (out / "loads.h5").exists():
            water_figure(album, out / "loads.h5")
        if plane.sizes["finger"] == 1 and (measured := flow.files.optional("pressure.h5")):
            with read_plane(measured) as series:
                pressure_figure(album, series, plane, at)
    energy_figure(album, out)
    if film := flow.files.optional("images.h5"):
        camera_picture(album, film, at)
    mesh_figures(album, read_planforms(motion / "planform.h5"), plane)


def print_figures(files: StageFiles) -> Path:
    """Write the pictures of a report that is made for print, and series.csv; returns the folder.

    The film and the frames of the slider are left out.
    """
    album = PrintAlbum(files.out / "print")
    with _flow(files) as flow:
        _others(album, flow)
        instant_figures(album, flow)
        write_table(album.folder / "series.csv", series(flow))
    for entry in FIGURES.read(files.required("figures/figures.json", "figures"))["entries"]:
        if entry["section"] == "space":
            with Image.open(files.figures / entry["file"]) as picture:
                album.add(np.asarray(picture.convert("RGB")), entry["file"])
    return album.folder


def run(scene: Scene, quiet: bool = False, threads: int = 1) -> None:
    """Run the stage figures."""
    files = StageFiles(scene)
    entries = make_figures(files, threads)
    if not quiet:
        print(f"{len(entries)} pictures in {files.figures}")
