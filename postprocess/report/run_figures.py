"""Pictures of how the flow was computed and seen: the solver's tables, the mesh, the camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from fileio.formats.recording import open_recording_file
from fileio.formats.records import POWER, POWER_TERMS, RUN
from postprocess.draw import animation
from postprocess.draw import mesh as draw_mesh
from postprocess.draw import solver as draw_solver
from postprocess.draw.style import HEIGHT, WIDTH
from postprocess.evidence.strokes import REST, progress
from postprocess.report.picture_index import Album
from postprocess.report.wording import balance_sentence


def energy_figure(album: Album, out: Path) -> None:
    """Where the finger's work goes."""
    terms = POWER_TERMS.read(out / "run/power_terms.csv")
    figure = draw_solver.energy(POWER.read(out / "run/power.csv"), terms)
    alt = "Work of the finger over time, and what it has become, stacked."
    caption = balance_sentence(RUN.read(out / "run/run.json")["power_balance"])
    album.add(figure, "energy.svg", "run", alt, caption)


def mesh_figures(album: Album, planforms: list[dict[str, np.ndarray]], plane: xr.Dataset) -> None:
    """The planform at three bends."""
    outline, bend = plane["outline"].values, plane["bend"].values[:, 0]
    low, high = outline.min(axis=(0, 1, 2)) - 0.02, outline.max(axis=(0, 1, 2)) + 0.02
    limits = (low[0], high[0], low[1], high[1])
    done = progress(plane)
    end = int(np.argmax(np.abs(done - done[0])))
    if np.ptp(bend) > REST:
        wanted = np.array([bend[0], 0.5 * (bend[0] + bend[end]), bend[end]])[:, None]
        known = [planform["bend"][:, None] for planform in planforms]
        now = bend[:, None]
    else:  # a body that does not turn is known by its place
        half = int(np.argmin(np.abs(done - 0.5 * done[end])))
        now = outline[:, 0].mean(axis=1)
        wanted = now[[0, half, end]]
        known = [planform["points"][:, planform["wall"]].mean(axis=1) for planform in planforms]
    drawn = [_nearest_shape(known, place) for place in wanted]
    shapes = [planforms[mesh]["points"][knot] for mesh, knot in drawn]
    at = np.degrees([planforms[mesh]["bend"][knot] for mesh, knot in drawn])
    used = [planforms[mesh] for mesh, _ in drawn]
    lines = [
        draw_mesh.edges([mesh["triangles"][mesh["body"] == 0], mesh["quads"]]) for mesh in used
    ]
    alt = "The planform of the mesh around the finger at the start, middle and end of the stroke."
    caption = "The mesh in the laser sheet follows the finger; its layers at the wall stay."
    image = animation.drawn(draw_mesh.planform(shapes, at, lines, limits))
    animation.write_picture(image, album.folder / "planform.webp", quality=80)
    album.add(None, "planform.webp", "mesh", alt, caption, wide=True)


def _nearest_shape(known: list[np.ndarray], wanted: np.ndarray) -> tuple[int, int]:
    """The planform and its knot whose place (knot, component) is nearest to the wanted one."""
    apart = [np.linalg.norm(places - wanted, axis=1) for places in known]
    mesh = int(np.argmin([distances.min() for distances in apart]))
    return mesh, int(np.argmin(apart[mesh]))


def camera_picture(album: Album, recording: Path, time: float) -> None:
    """What the camera sees nearest to `time` (s)."""
    with open_recording_file(recording) as file:
        index = int(np.argmin(np.abs(file["time"][:] - time)))
        image, at = file["frames"][index].astype(float), float(file["time"][index])
    rows = round(image.shape[1] * HEIGHT / WIDTH)  # of the shape of the figures beside it
    grey = np.clip(image[:rows] / np.percentile(image, 99.7), 0, 1) * 255
    animation.write_picture(grey.astype(np.uint8), album.folder / "camera.webp", quality=80)
    alt = f"A synthetic camera picture of the seeded water at {at:.3f} s; the finger is black."
    caption = f"What the virtual camera sees at {at:.3f} s; PIV is done on such pictures."
    album.add(None, "camera.webp", "run", alt, caption)
