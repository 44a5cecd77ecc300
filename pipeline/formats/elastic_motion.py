"""The motion of a finger that pressure and water make together, `run/elastic_motion.h5`."""

from pathlib import Path

from piv.files.schema import Schema, variables

FILE = Path("run/elastic_motion.h5")  # in a level's folder

SCHEMA = Schema(
    "elastic-motion",
    variables("""
time  time  s  time steps of the run
pressure  time  Pa  in the chambers
delta  time, slice  rad  elastic turn of each slice against the shape without load
contact_force  time  N  of the film on the whole finger, away from what its tip touches
tip_change  -  m  by which the run's own loads would move the tip, at most: the check of the motion
open_energy  -  1  work and energy that do not match, over the largest work
moment_share  -  1  largest moment on a joint over that of the table in states.h5
alternated  -  s  time for which the loads were continued as a line, since they alternated
"""),
    version=3,
)

read_elastic_motion, write_elastic_motion = SCHEMA.read, SCHEMA.write
