"""Pictures of the finger: the states behind its motion, and what the water does to it."""

from pathlib import Path

import numpy as np

from pipeline.formats.finger_loads import read_loads
from pipeline.formats.kinematics import read_kinematics
from postprocess.draw import series as draw_series
from postprocess.draw import water as draw_water
from postprocess.report.picture_index import Album
from postprocess.words import minus


def water_figure(album: Album, path: Path) -> None:
    """What the water does to the finger; nothing where the finger's stiffness is not known."""
    loads = read_loads(path)
    if "bend_in_air" not in loads:
        return
    coupled = bool(loads.attrs["coupled"])
    bend, free = (np.degrees(loads[name].values) for name in ("bend_in_water", "bend_unloaded"))
    at = int(np.argmax(np.abs(bend - free)))
    alt = "Bend, loads along the finger and its energy over time."
    caption = (
        f"At {loads['step'].values[at]:.3f} s the water holds the finger at"
        f" {minus(f'{bend[at]:.1f}')}°, which its pressure"
        f" would bend to {minus(f'{free[at]:.1f}')}° without load."
        if coupled
        else "The motion is prescribed: it is that of a finger that no load bends. The broken"
        " lines are the same finger in air and in modelled water; the work of the pressure is that"
        " of what drives the motion."
    )
    caption += (
        " Energy: what pressure, water and weight (with buoyancy) have put in, what is held in"
        " bending and motion, and what damping has taken."
    )
    figure = draw_water.water_on_finger(loads)
    album.add(figure, "water.svg", "water", alt, caption)


def bending_figure(album: Album, path: Path) -> None:
    """Bend over pressure of the states, and of the paper's equations."""
    kinematics = read_kinematics(path)
    if kinematics.values("state_pressure") is None:
        return  # a motion over time, as of a coupled run, follows from no states
    pressure, bend = (kinematics.data[name].values for name in ("state_pressure", "state_bend"))
    std = kinematics.values("state_bend_std")
    caption = "The states of the finger that drive its motion. " + (
        "The band is the standard uncertainty from roof and channel heights, the split of the"
        " material's stiffness, the mesh and ±0.2 kPa (docs/fea.md)."
        if std is not None
        else "They carry no uncertainty, so no band is drawn."
    )
    figure = draw_series.bending(pressure, bend, std, kinematics.values("paper_bend"))
    alt = "Bend over pressure of the states that drive the motion."
    album.add(figure, "bending.svg", "motion", alt, caption)
