"""A finger's motion as a recording shows it, `motion.h5`: for `motion.source = "recording"`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from fileio.schema import Schema, Variable

SCHEMA = Schema(
    "recorded-motion",
    2,
    "write it again with python -m postprocess.lab motion",
    (
        Variable("time", "time", "s", "of the simulation's clock"),
        Variable("pressure", "time", "Pa", "at which the scene's own finger bends as much"),
        Variable("bend", "time", "rad", "bend angle"),
        Variable("state_pressure", "state", "Pa", "pressure of each shape, ascending"),
        Variable(
            "profile_x", "state, point", "m", "lower layer of each shape, in the actuator frame"
        ),
        Variable("profile_y", "state, point", "m", "of the same points"),
        Variable("thickness", "state, point", "m", "thickness of each shape"),
        Variable("seen", "seen", "s", "of single frames"),
        Variable("seen_bend", "seen", "rad", "bend angle that each frame shows"),
        Variable(
            "seen_radius", "seen", "m", "radius of its least-squares circle, signed", finite=False
        ),
        Variable("seen_residual", "seen", "m", "rms distance from that circle"),
        Variable("recording", "-", "", "title of the recording"),
        Variable("dpiv_sha256", "-", "", "digest of its dpiv.toml"),
        Variable("registration", "-", "", "JSON: where the finger lies in the pictures"),
    ),
)


def write_recorded_motion(path: Path, values: Mapping[str, Any]) -> None:
    """Write motion.h5 from SCHEMA's variables and attributes by name."""
    SCHEMA.write(path, values)


def read_recorded_motion(path: Path) -> xr.Dataset:
    """SCHEMA's variables. StageError in one sentence where the file is of no use."""
    return SCHEMA.read(path)
