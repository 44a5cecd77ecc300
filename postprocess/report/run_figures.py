"""Pictures of how the flow was computed and seen: the solver's tables, the mesh, the camera."""

from pathlib import Path

import numpy as np
import xarray as xr

from pipeline.formats.records import POWER, POWER_TERMS, RUN, THROUGH_FLOW
from piv.formats.recording import open_recording_file
from postprocess.draw import mesh as draw_mesh
from postprocess.draw import solver as draw_solver
from postprocess.draw.style import HEIGHT, WIDTH
from postprocess.report.picture_index import Album
from postprocess.report.wording import balance_sentence


def energy_figure(album: Album, out: Path) -> None:
    """Draw where the finger's work goes."""
    balance = RUN.read(out / "run/run.json")["power_balance"]
    tables = POWER.read(out / "run/power.csv"), POWER_TERMS.read(out / "run/power_terms.csv")
    through = THROUGH_FLOW.read(out / "run/through_flow.csv") if "supplied" in balance else None
    alt = "Work of the finger over time, and what it has become, stacked."
    figure = draw_solver.energy(*tables, through)
    album.add(figure, "energy.svg", "solve", alt, balance_sentence(balance))


def mesh_figures(album: Album, planforms: list[dict[str, np.ndarray]], plane: xr.Dataset) -> None:
    """The planform without load, and at half and all of the largest."""
    outline = plane["outline"].values[:, :1]
    low, high = outline.min(axis=(0, 1, 2)) - 0.02, outline.max(axis=(0, 1, 2)) + 0.02
    high[0] = min(high[0], planforms[0]["points"][..., 0].max())  # of two fingers the left half
    limits = (low[0], high[0], low[1], high[1])
    knots = [(m, k) for m, planform in enumerate(planforms) for k in range(len(planform["bend"]))]
    parameter = np.concatenate([planform["shape_parameter"] for planform in planforms])
    far = parameter[np.argmax(np.abs(parameter))]
    drawn = [knots[int(np.argmin(np.abs(parameter - part * far)))] for part in (0, 0.5, 1)]
    shapes = [planforms[mesh]["points"][knot] for mesh, knot in drawn]
    at = np.degrees([planforms[mesh]["bend"][knot] for mesh, knot in drawn])
    used = [planforms[mesh] for mesh, _ in drawn]
    lines = [
        draw_mesh.edges([mesh["triangles"][mesh["body"] == 0], mesh["quads"]]) for mesh in used
    ]
    alt = "The planform of the mesh around the finger at rest, half-way and at the farthest."
    caption = "The mesh in the laser sheet follows the finger; its layers at the wall stay."
    figure = draw_mesh.planform(shapes, at, lines, limits)
    album.add(figure, "planform.webp", "mesh", alt, caption, layout="wide")


def camera_picture(album: Album, recording: Path, time: float) -> None:
    """What the camera sees nearest to `time` (s)."""
    with open_recording_file(recording) as file:
        index = int(np.argmin(np.abs(file["time"][:] - time)))
        image, at = file["frames"][index].astype(float), float(file["time"][index])
    rows = round(image.shape[1] * HEIGHT / WIDTH)  # of the shape of the figures beside it
    grey = np.clip(image[:rows] / np.percentile(image, 99.7), 0, 1) * 255
    alt = f"A synthetic camera picture of the seeded water at {at:.3f} s; the finger is black."
    caption = f"What the virtual camera sees at {at:.3f} s; PIV is done on such pictures."
    album.add(grey.astype(np.uint8), "camera.webp", "solve", alt, caption)
