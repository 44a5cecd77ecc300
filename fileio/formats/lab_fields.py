"""Vector by vector, where laboratory and simulation differ: `fields.h5` of a comparison."""

from __future__ import annotations

from fileio.schema import Schema, variables

SCHEMA = Schema(
    "lab-fields",
    "run make compare again",
    variables("""
time  time  s  of the simulation's clock
y  y  m  in the camera frame
x  x  m  in the camera frame
error~  time, component, y, x  m/s  simulation less laboratory, 0 = x, 1 = y; NaN: not common
u_val~  time, component, y, x  m/s  standard uncertainty of the error
significance~  time, y, x  1  size of the error over its uncertainty
picture?  row, column  1  a picture of the recording
picture_time?  -  s  of the picture, by the simulation's clock
"""),
)
read_fields, write_fields = SCHEMA.read, SCHEMA.write
