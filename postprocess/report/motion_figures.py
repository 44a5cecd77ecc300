"""Pictures of the motion for the report: pressure, bend and tip speed; the states behind it; the actuator's studies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from fileio.atomic import write_bytes
from fileio.formats.finger_loads import read_loads
from fileio.formats.kinematics import read_kinematics
from postprocess.draw import series as draw_series
from postprocess.draw import water as draw_water
from postprocess.evidence.strokes import REST, peak_tip_speed, tip_speed
from postprocess.report.picture_index import Album

STUDIES = {
    "theta": "wedge angles of 0 to 30°",
    "width": "widths of 12, 20 and 28 mm",
    "materials": "three pairs of materials",
}


def motion_figure(album: Album, path: Path, plane: xr.Dataset, rigid: bool) -> None:
    """What drives the finger, its bend angle and its tip's speed over time; of a rigid body its path or turn and its speed."""
    kinematics = read_kinematics(path)
    clock, drive = kinematics.law.x, kinematics.data["pressure"].values
    times, tip = plane["time"].values, plane["tip"].values
    turn = np.degrees(plane["bend"].values[:, 0])
    drives = np.ptp(turn) > REST
    rows = [(times, tip_speed(times, tip)[:, 0], "tip speed, m/s")]
    if rigid:
        name = "turn, °" if drives else "distance, m"
        rows.insert(0, (clock, np.degrees(drive) if drives else drive, name))
    else:
        rows.insert(0, (times, turn, "bend angle, °"))
        rows.insert(0, (clock, drive / 1e3, "pressure, kPa"))
    peak, at = peak_tip_speed(times, tip)
    alt = (
        "Motion of the body over time."
        if rigid
        else "Pressure, bend angle and tip speed over time."
    )
    caption = f"Peak tip speed {peak:.3f} m/s at {at:.3f} s."
    album.add(draw_series.motion(rows), "motion.svg", "motion", alt, caption)


def water_figure(album: Album, path: Path) -> None:
    """What the water does to the finger, from loads.h5; nothing where the finger's stiffness is not known."""
    loads = read_loads(path)
    if "bend_in_air" not in loads:
        return
    bend, free = (np.degrees(loads[name].values) for name in ("bend", "bend_unloaded"))
    at = int(np.argmax(np.abs(bend - free)))
    coupled = bool(np.abs(bend - free)[at] > REST)
    alt = "Bend, tip path, loads along the finger and its energy over time."
    caption = (
        f"At {loads['step'].values[at]:.3f} s the water holds the finger at {bend[at]:.1f}°, which its pressure would bend to {free[at]:.1f}°."
        if coupled
        else "The motion is prescribed: it is that of a finger that no load bends; the work of the pressure is that of what drives it."
    )
    album.add(
        draw_water.water_on_finger(loads, "coupled" if coupled else "prescribed"),
        "water.svg",
        "water",
        alt,
        caption,
    )


def bending_figure(album: Album, path: Path, length: float) -> None:
    """Bending radius over pressure of the states that drive the motion, beside the paper's equations; `length` in m."""
    kinematics = read_kinematics(path)
    names = ("state_pressure", "state_bend", "paper_bend")
    pressure, bend, paper = (kinematics.data[name].values for name in names)
    std = kinematics.values("state_bend_std")
    band = (
        "The band is the standard uncertainty from roof and channel heights, the split of the material's stiffness, the mesh"
        " and ±0.2 kPa (docs/fea.md)."
        if std is not None
        else "These states carry no uncertainty, so no band is drawn."
    )
    figure = draw_series.bending(pressure, bend, std, paper, length)
    alt = "Bending radius over pressure from the states that drive the motion, with the paper's equations."
    caption = (
        f"R from the states that drive the motion; the paper's equations (1)–(6) dashed. {band}"
    )
    album.add(figure, "bending.svg", "motion", alt, caption)


def study_figures(album: Album, scene_folder: Path, motion: dict[str, Any]) -> None:
    """The actuator's studies, where `make fea-studies` left some beside the bending states that move the finger."""
    if motion["source"] not in ("fea", "structure"):
        return
    folder = (scene_folder / motion["states"]).resolve().parent / "studies"
    scene = folder.parents[1].name
    for name, varied in STUDIES.items():
        source = folder / f"{name}.svg"
        if source.exists():
            write_bytes(album.folder / f"fea_{source.name}", source.read_bytes())
            alt = f"Bending radius over pressure for {varied}, from the FEA."
            caption = f"What the FEA gives for {varied}; all numbers and versions: results.md in kinematics/studies of {scene}."
            album.add(None, f"fea_{source.name}", "motion", alt, caption)
