"""The finger's motion as the water and the pressure in its chambers make it, `elastic_motion.h5`: for `motion.source = "structure"`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from fileio.schema import Schema, Variable

SCHEMA = Schema(
    "elastic-motion",
    1,
    "delete it and run make with COUPLED=1 again",
    (
        Variable("time", "time", "s", "time steps of the structure"),
        Variable("pressure", "time", "Pa", "in the chambers"),
        Variable("delta", "time, slice", "rad", "elastic turn of each slice against the shape without load"),
        Variable("knot", "knot", "s", "times of the shapes, ascending"),
        Variable("profile_x", "knot, point", "m", "lower layer of each shape, in the actuator frame"),
        Variable("profile_y", "knot, point", "m", "of the same points"),
        Variable("thickness", "knot, point", "m", "thickness of each shape"),
        Variable("made_of", "-", "", "digest of the scene and of the loads that it follows from"),
        Variable("tip_change", "-", "m", "largest change of the tip's place against the motion before; infinite of the first"),
        Variable("bend_change", "-", "rad", "largest change of the tip's turn against the motion before; infinite of the first"),
    ),
)  # fmt: skip


def write_elastic_motion(path: Path, values: Mapping[str, Any]) -> None:
    """Write elastic_motion.h5 from SCHEMA's variables and attributes by name."""
    SCHEMA.write(path, values)


def read_elastic_motion(path: Path) -> xr.Dataset:
    """SCHEMA's variables. StageError in one sentence where the file is of no use."""
    return SCHEMA.read(path)
