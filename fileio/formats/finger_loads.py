"""What the water does to the finger, `loads.h5`: forces along it over time, and the deflection that they would cause.

Of a rigid body it says `unknown` alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from fileio.schema import Schema, Variable

SCHEMA = Schema(
    "finger-loads",
    2,
    "delete it and run make again",
    (
        Variable("time", "time", "s", "of the solver's samples of the finger's surface", True),
        Variable("pressure", "time", "Pa", "in the chambers; of a pinch that of the shape", True),
        Variable("arc", "slice", "m", "middle of each slice from the root, at rest; the first is the clamped length", True),
        Variable("force", "time, slice, axis", "N", "of the water on each slice of a whole finger, along it and towards the ventral side", True),
        Variable("torque", "time, slice", "N m", "of the water about the middle of each slice, positive towards the ventral side", True),
        Variable("root_moment", "time", "N m", "of the water about the middle of the root, positive towards the ventral side", True),
        Variable("deflection", "time", "rad", "turn of the tip that water, weight and inertia would cause if giving way did not lessen them; of a finger of known stiffness", True),
        Variable("dry_deflection", "time", "rad", "the same without the water's forces: by weight, buoyancy and inertia", True),
        Variable("step", "step", "s", "time steps of the finger's own motion", True),
        Variable("bend", "step", "rad", "bend angle of the finger as it was run", True),
        Variable("bend_unloaded", "step", "rad", "of the finger that no load bends, at the same pressure", True),
        Variable("bend_in_air", "step", "rad", "of the finger at the same pressure history without water", True),
        Variable("tip", "step, axis", "m", "place of the tip as it was run, in the tank frame", True),
        Variable("tip_unloaded", "step, axis", "m", "of the finger that no load bends", True),
        Variable("tip_in_air", "step, axis", "m", "without water", True),
        Variable("pressure_work", "step", "J", "of the chambers' pressure, of a prescribed motion of what drives it", True),
        Variable("water_work", "step", "J", "of the water on the finger", True),
        Variable("weight_work", "step", "J", "of weight and buoyancy", True),
        Variable("elastic_energy", "step", "J", "held by bending against the shape without load", True),
        Variable("kinetic_energy", "step", "J", "of the rubber and of the water in the gaps", True),
        Variable("damping_loss", "step", "J", "lost in the rubber", True),
        Variable("unknown", "-", "", "why the deflection is not known, as a sentence; empty where it is"),
        Variable("largest_deflection", "-", "rad", "of largest size, signed", True),
        Variable("largest_at", "-", "s", "when", True),
        Variable("bend_then", "-", "rad", "bend angle of the prescribed motion then", True),
        Variable("stroke", "-", "rad", "range of the bend angle", True),
    ),
)  # fmt: skip


def write_loads(out: Path, values: Mapping[str, Any]) -> None:
    """Write loads.h5 of a level's folder from SCHEMA's variables and attributes by name."""
    SCHEMA.write(out / "loads.h5", dict(values))


def read_loads(path: Path) -> xr.Dataset:
    """SCHEMA's variables. StageError in one sentence where the file is of no use."""
    return SCHEMA.read(path)


def deflection_sentence(values: Mapping[str, Any]) -> str:
    """The a-posteriori check in words, from the attributes of a loads.h5."""
    if values["unknown"]:
        return str(values["unknown"])
    most, then, stroke = (
        math.degrees(values[name]) for name in ("largest_deflection", "bend_then", "stroke")
    )
    share = f", {abs(most) / stroke:.0%} of the stroke" if stroke else ""
    return (
        f"The motion is prescribed: at {values['largest_at']:.3g} s, where the finger is at {then:.1f}°, the loads on it would"
        f" turn its tip by {most:+.1f}°{share}, if giving way did not lessen them."
    )
