"""Loads of the water along the finger and the deflection that they would cause, `loads.h5`.

Of a rigid body it holds `unknown` alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fileio.schema import Schema, variables

SCHEMA = Schema(
    "finger-loads",
    "delete it and run make again",
    variables("""
time?  time  s  of the solver's samples of the finger's surface
pressure?  time  Pa  in the chambers; of a pinch that of the shape
arc?  slice  m  middle of each slice from the root, at rest; the first is the clamped length
force?  time, slice, axis  N  on each slice of a whole finger: along it, towards the ventral side
torque?  time, slice  N m  about the middle of each slice, positive towards the ventral side
root_moment?  time  N m  about the middle of the root, positive towards the ventral side
deflection?  time  rad  turn of the tip under these loads, by water, weight and inertia
dry_deflection?  time  rad  the same without the water's forces: by weight, buoyancy and inertia
step?  step  s  time steps of the finger's own motion
bend?  step  rad  bend angle of the finger as it was run
bend_unloaded?  step  rad  of the finger that no load bends, at the same pressure
bend_in_air?  step  rad  of the finger at the same pressure history without water
tip?  step, axis  m  place of the tip as it was run, in the tank frame
tip_unloaded?  step, axis  m  of the finger that no load bends
tip_in_air?  step, axis  m  without water
pressure_work?  step  J  of the chambers' pressure; where the motion is prescribed: of its drive
water_work?  step  J  of the water on the finger
weight_work?  step  J  of weight and buoyancy
elastic_energy?  step  J  of bending against the shape without load
kinetic_energy?  step  J  of the rubber and of the water in the gaps
damping_loss?  step  J  lost in the rubber
unknown  -  -  why the deflection is not known, as a sentence; empty where it is
largest_deflection?  -  rad  of largest size, signed
largest_at?  -  s  when
bend_then?  -  rad  bend angle of the prescribed motion then
stroke?  -  rad  range of the bend angle
"""),
)
read_loads = SCHEMA.read


def write_loads(out: Path, values: Mapping[str, Any]) -> None:
    """Write loads.h5 of a level's folder from SCHEMA's variables and attributes by name."""
    SCHEMA.write(out / "loads.h5", dict(values))


def deflection_sentence(values: Mapping[str, Any]) -> str:
    """The a-posteriori check in words, from the attributes of a loads.h5."""
    if values["unknown"]:
        return str(values["unknown"])
    most, then, stroke = (
        math.degrees(values[name]) for name in ("largest_deflection", "bend_then", "stroke")
    )
    turned = f"{most:+.1f}".replace("-", "−")
    share = f", {abs(most) / stroke:.0%} of the stroke" if stroke else ""
    return (
        f"The motion is prescribed: at {values['largest_at']:.3g} s, where the finger is at"
        f" {then:.1f}°, the loads on it would turn its tip by {turned}°{share}, if giving way"
        " did not lessen them."
    )
