"""Loads of the water along the finger, its energy, and its motion in air and water, `loads.h5`.

Of a rigid body it holds `unknown` and `coupled` alone.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from piv.files.schema import Schema, variables

SCHEMA = Schema(
    "finger-loads",
    variables("""
time?  time  s  of the solver's samples of the finger's surface
pressure?  time  Pa  in the chambers; of a pinch that of the shape
arc?  slice  m  middle of each slice from the root, at rest; the first is the clamped length
force?  time, slice, axis  N  on each slice of a whole finger: along it, towards the ventral side
torque?  time, slice  N m  about the middle of each slice, positive towards the ventral side
root_moment?  time  N m  about the middle of the root, positive towards the ventral side
step?  step  s  time steps of the finger's own motion
bend?  step  rad  bend angle of the finger as it was run
bend_unloaded?  step  rad  of the finger that no load bends, at the same pressure
bend_in_air?  step  rad  of the finger at the same pressure history without water
bend_in_water?  step  rad  in water: as run where coupled, else in modelled water
pressure_work?  step  J  of the chambers' pressure; where the motion is prescribed: of its drive
water_work?  step  J  of the water on the finger
weight_work?  step  J  of weight and buoyancy
elastic_energy?  step  J  of bending against the shape without load
kinetic_energy?  step  J  of the rubber and of the water in the gaps
damping_loss?  step  J  lost in the rubber
loss_factor?  band  1  lowest and highest of the rubber, where the scene gives none
largest_bend?  band  rad  in modelled water with these
settled?  band  s  time after which the bend stays within 5 % of its final value
coupled  -  1  1: pressure and water made the motion; 0: it is prescribed
unknown  -  -  why the motion in water is not known, as a sentence; empty where it is
tip_change?  -  m  coupled: by which the run's own loads would move the tip, at most
open_energy?  -  1  coupled: work and energy that do not match, over the work
moment_share?  -  1  coupled: largest moment on a joint over that of the table in states.h5
contact_force?  -  N  coupled: largest force of the film on a whole finger; 0: it touches nothing
contact_impulse?  -  N s  coupled: impulse of the film on a whole finger
alternated?  -  s  coupled: time for which the loads were continued as a line
"""),
    version=4,
)
read_loads, write_loads = SCHEMA.read, SCHEMA.write
_WORTH = 1.0  # degrees of bend
SETTLED = 0.05  # of the final bend


def _damping(values: Mapping[str, Any]) -> str:
    """What the band of the rubber's loss factor does, in words; empty where none is known."""
    if "loss_factor" not in values:
        return ""
    (low, high), bend, settled = (
        np.asarray(values[name]) for name in ("loss_factor", "largest_bend", "settled")
    )
    least, most = np.degrees(np.sort(bend))
    soonest, latest = np.sort(settled)
    return (
        f" The rubber's loss factor is between {low:.2f} and {high:.2f}. In modelled water the"
        f" largest bend is then {least:.1f} to {most:.1f}°. The bend stays within"
        f" {100 * SETTLED:.0f} % of its final value after {soonest:.2f} to {latest:.2f} s."
    ).replace("-", "−")


def motion_sentence(values: Mapping[str, Any]) -> str:
    """What the water does to the motion, in words, from the values of a loads.h5."""
    if values["unknown"] and not values["coupled"]:
        return str(values["unknown"])
    if values["coupled"]:
        late = values["alternated"]
        line = f", which it continued as a line for {late:.2g} s," if late else ""
        return (
            "Pressure and water make the finger's motion together. Computed again under the loads"
            f" of the run{line} its tip moves by {values['tip_change'] * 1e3:.2g} mm, and"
            f" {100 * values['open_energy']:.1f} % of the work is unexplained."
            + (
                f" Its joints bear up to {values['moment_share']:.1f} times the moment to which its"
                " bending was analysed."
                if values["moment_share"] > 1
                else ""
            )
            + (
                " A viscous film stops the tip without rebound. It pushes each finger with at"
                f" most {values['contact_force']:.2g} N, and with"
                f" {values['contact_impulse']:.2g} N s in all."
                if values["contact_force"] > 0
                else ""
            )
            + _damping(values)
            + f" {values['unknown']}".rstrip()
        )
    bend, wet = (np.degrees(np.asarray(values[name])) for name in ("bend", "bend_in_water"))
    step, apart = np.asarray(values["step"]), wet - bend
    places = sorted({int(np.argmin(apart)), int(np.argmax(apart))})
    parts = [
        f"at {wet[k]:.0f}° in place of {bend[k]:.0f}° at {step[k]:.2f} s".replace("-", "−")
        for k in places
        if abs(apart[k]) >= _WORTH
    ]
    if not parts:
        return f"The motion is prescribed; modelled water changes it by less than {_WORTH:g}°."
    return (
        "The motion is prescribed. By a chain of slices in modelled water, a finger with this"
        f" pressure would be {', and '.join(parts)}: use COUPLED=1 if that matters."
        + _damping(values)
    )
