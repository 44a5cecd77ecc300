"""Pictures and a film of the flow in space, of the fields that the run has written."""

from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
import xarray as xr
from vtkmodules.vtkCommonCore import vtkLogger

from pipeline.paraview.fields import RunFields
from pipeline.paraview.grids import mirror_planes, with_mirror_image
from piv.formats.plane_series import make_plane
from piv.plots.film import write_film
from postprocess.draw.flow import EDGES
from postprocess.draw.space import Stage, View
from postprocess.draw.style import MM, WIDTH
from postprocess.evidence.strokes import stroke_window
from postprocess.report.flow_figures import Flow
from postprocess.report.picture_index import Album

FRAMES = 41
_FILM_HZ = 10.0
_TURN_DEG = (15.0, 50.0)  # of the camera from the film's first frame to its last
_STILL_DEG = 35.0
_OFF_WALL = 0.04  # of the finger's width
_DEPTH = 1.2  # of the finger's width: half of the depth that is shown
_BESIDE = 0.6  # of the finger's width: a plane that passes it
_MARGIN = 0.02  # m around the box, so that its corners have water
_SPACING = 5e-4  # m, of a plane's points
_QUALITY = 32  # VP9's crf


def _slice(fields: RunFields, view: View, time: float, z: float, flow: Flow) -> xr.Dataset:
    """The velocity at a time (s) in the plane `z` (m) beside the sheet."""
    box = view.box
    x, y = (np.arange(low, high, _SPACING) for low, high in (box[:2], box[2:4]))
    wider = tuple(end + side * _MARGIN for end, side in zip(box, (-1, 1) * 3, strict=True))
    water, walls = fields.grids(time, wider)
    plane = pv.ImageData(
        dimensions=(x.size, y.size, 1),
        spacing=(_SPACING, _SPACING, 1.0),
        origin=(x[0], y[0], -z - 1e-5),  # beside the plane of symmetry, where the mesh ends
    ).sample(water.cell_data_to_point_data())
    shape = (1, y.size, x.size)
    u, v = (plane["velocity"][:, k].reshape(shape) for k in (0, 1))
    more = {"valid": plane["vtkValidPointMask"].reshape(shape)}
    if z < -walls.bounds[4]:
        sheet = flow.planes["cfd"]
        more["outline"] = sheet["outline"].sel(time=[time], method="nearest").values
    return make_plane(x, y, u, v, time=np.array([time]), **more)


def space_figures(folder: Path, flow: Flow) -> list[dict[str, Any]]:
    """Two instants of the stroke, slices and a film; nothing of a plane run or without fields.

    Returns their entries in the index.
    """
    scene = flow.files.numbers
    fields, album = RunFields(scene), Album(folder)
    if scene.model.kind == "2d" or not fields.instants:
        return []
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)  # each way to draw that it tries
    width = scene.body.size if scene.body else scene.finger.width
    x0, x1, y0, y1 = flow.region()
    rate = flow.scale / width
    view = View(
        (x0, x1, y0, y1, -_DEPTH * width, _DEPTH * width), rate**2, 4 * rate, _OFF_WALL * width
    )
    stage = Stage(view)

    def picture(time: float, turn_deg: float) -> np.ndarray:
        water, walls = fields.grids(time, view.box)
        for plane in mirror_planes(scene):
            water, walls = (with_mirror_image(grid, plane) for grid in (water, walls))
        return stage.picture(water, walls, turn_deg)

    clock, last = flow.clock, fields.instants[-1].time
    middle, end = stroke_window(clock.time, clock.progress, (0.5, 0.9))
    name, _ = flow.words()
    what = f"surface of Q = {view.q:.0f} 1/s² around the {name}"
    for part, at, time in (
        ("middle", "The middle of the stroke", middle),
        ("end", "Nine tenths of the stroke", min(end, last)),
    ):
        file = f"space_{part}.webp"
        text = f"{at}, {time:.3f} s"
        alt = f"{text}: {what}, seen in space."
        album.add(picture(time, _STILL_DEG), file, "space", alt, text, time=float(time))
    planes = {
        f"z = {z * MM:.0f} mm": _slice(fields, view, middle, z, flow)
        for z in (0.0, width / 4, width * _BESIDE)
    }
    image = flow.images(planes, panel=(2 * WIDTH - EDGES) / len(planes), dpi=140)(middle)
    alt = f"Velocity and vorticity at {middle:.3f} s in three planes beside each other"
    caption = (
        f"How three-dimensional the flow is, {middle:.3f} s: in the sheet, half-way to the {name}'s"
        " side and beside it. Were the flow plane, all three would be alike; the tip's vortex ends"
        " where the colours fade, and bends into those along the edges."
    )
    album.add(image, "slices.webp", "space", alt, caption, layout="wide")
    times = np.linspace(0.0, last, FRAMES)
    turns = np.linspace(*_TURN_DEG, FRAMES)
    frames = (picture(t, turn) for t, turn in zip(times, turns, strict=True))
    write_film(frames, album.folder / "space.webm", _FILM_HZ, crf=_QUALITY)
    stage.close()
    caption = (
        f"Surface on which Q, half of rotation squared less strain squared, is (U/w)² ="
        f" {view.q:.0f} 1/s², with the peak tip speed U and the {name}'s width w: vortices as"
        " bodies. Purple turns clockwise in the laser sheet (green frame), orange counter-"
        "clockwise, grey about another axis."
        f" {(FRAMES - 1) / _FILM_HZ / last:.0f} times slowed down."
    )
    alt = f"Film of the {what} while it moves; the camera turns slowly"
    album.add(None, "space.webm", "film", alt, caption)
    return album.entries
