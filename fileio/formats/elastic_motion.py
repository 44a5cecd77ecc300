"""A finger's motion under pressure, water and inertia, `elastic_motion.h5`.

It serves `motion.source = "structure"`.
"""

from __future__ import annotations

from fileio.schema import Schema, variables

SCHEMA = Schema(
    "elastic-motion",
    "delete it and run make with COUPLED=1 again",
    variables("""
time  time  s  time steps of the structure
pressure  time  Pa  in the chambers
delta  time, slice  rad  elastic turn of each slice against the shape without load
knot  knot  s  times of the shapes, ascending
profile_x  knot, point  m  lower layer of each shape, in the actuator frame
profile_y  knot, point  m  of the same points
thickness  knot, point  m  thickness of each shape
made_of  -  -  digest of the scene and of the loads that it follows from
tip_change  -  m  largest change of the tip's place against the motion before; the first: infinite
bend_change  -  rad  largest change of the tip's turn, likewise
"""),
)
read_elastic_motion, write_elastic_motion = SCHEMA.read, SCHEMA.write
