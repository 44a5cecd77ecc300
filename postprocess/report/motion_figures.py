"""Pictures of the motion for the report: pressure, bend and tip speed; the states behind it; the actuator's studies."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from fileio.atomic import write_bytes
from postprocess.draw import series as draw_series
from postprocess.evidence.stage_files import StageFiles, read_arrays, scene_numbers
from postprocess.evidence.strokes import peak_tip_speed, tip_speed
from postprocess.report.picture_index import Album

DOCS_FEA = Path(__file__).resolve().parents[2] / "docs" / "fea"
STUDIES = {
    "theta": "wedge angles of 0 to 30°",
    "width": "widths of 12, 20 and 28 mm",
    "materials": "three pairs of materials",
}


def motion_figure(album: Album, files: StageFiles, plane: xr.Dataset) -> None:
    """Pressure, bend angle and tip speed over time."""
    drive = read_arrays(files.out / "kinematics.h5", ("time", "pressure"))
    times = plane["time"].values
    speed = tip_speed(times, plane["tip"].values)[:, 0]
    figure = draw_series.motion(drive["time"], drive["pressure"], times, plane["bend"].values[:, 0], speed)
    peak, at = peak_tip_speed(times, plane["tip"].values)
    album.add(
        figure,
        "motion.svg",
        "motion",
        "Pressure, bend angle and tip speed over time.",
        f"Peak tip speed {peak:.3f} m/s at {at:.3f} s.",
    )


def bending_figure(album: Album, files: StageFiles) -> None:
    """Bending radius over pressure of the states that drive the motion, beside the paper's equations."""
    names = ("state_pressure", "state_bend", "paper_bend")
    states = read_arrays(files.out / "kinematics.h5", names, optional=("state_bend_std",))
    std = states.get("state_bend_std")
    length = scene_numbers(files)["finger"]["length"]
    band = (
        "The band is the standard uncertainty from roof and channel heights, the split of the material's stiffness, the mesh"
        " and ±0.2 kPa (docs/fea.md)."
        if std is not None
        else "These states carry no uncertainty, so no band is drawn."
    )
    album.add(
        draw_series.bending(
            states["state_pressure"], states["state_bend"], std, states["paper_bend"], length
        ),
        "bending.svg",
        "motion",
        "Bending radius over pressure from the states that drive the motion, with the paper's equations.",
        f"R from the states that drive the motion; the paper's equations (1)–(6) dashed. {band}",
    )


def study_figures(album: Album) -> None:
    """The actuator's studies as `make fea-studies` left them; they belong to the project, not to one scene."""
    for name, varied in STUDIES.items():
        source = DOCS_FEA / f"{name}.svg"
        if source.exists():
            write_bytes(album.folder / f"fea_{source.name}", source.read_bytes())
            alt = f"Bending radius over pressure for {varied}, from the FEA."
            caption = f"What the FEA gives for {varied}; all numbers and versions in docs/fea/results.md."
            album.add(None, f"fea_{source.name}", "motion", alt, caption)
