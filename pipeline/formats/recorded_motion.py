"""A finger's motion from a recording, `motion.h5`: for `motion.source = "recording"`."""

from piv.files.schema import Schema, variables

SCHEMA = Schema(
    "recorded-motion",
    variables("""
time  time  s  of the simulation's clock
pressure  time  Pa  at which the scene's own finger bends as much
bend  time  rad  bend angle
state_pressure  state  Pa  pressure of each shape, ascending
profile_x  state, point  m  lower layer of each shape, in the actuator frame
profile_y  state, point  m  of the same points
thickness  state, point  m  thickness of each shape
seen  seen  s  of single frames
seen_bend  seen  rad  bend angle that each frame shows
seen_radius~  seen  m  radius of its least-squares circle, signed
seen_residual  seen  m  rms distance from that circle
recording  -  -  title of the recording
dpiv_sha256  -  -  digest of its dpiv.toml
registration  -  -  JSON: where the finger lies in the pictures
"""),
    remedy="write it again as docs/formats.md describes it",
)
read_recorded_motion, write_recorded_motion = SCHEMA.read, SCHEMA.write
