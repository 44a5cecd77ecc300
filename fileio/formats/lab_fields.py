"""Where laboratory and simulation differ, `fields.h5` of a comparison: vector by vector, with one picture of the recording."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from fileio.schema import Schema, Variable

SCHEMA = Schema(
    "lab-fields",
    2,
    "run make compare again",
    (
        Variable("time", "time", "s", "of the simulation's clock"),
        Variable("y", "y", "m", "in the camera frame"),
        Variable("x", "x", "m", "in the camera frame"),
        Variable("error", "time, component, y, x", "m/s", "simulation less laboratory, component 0 = x, 1 = y; NaN where not common", finite=False),
        Variable("u_val", "time, component, y, x", "m/s", "standard uncertainty of the error", finite=False),
        Variable("significance", "time, y, x", "1", "size of the error over its uncertainty", finite=False),
        Variable("picture", "row, column", "1", "a picture of the recording", True),
        Variable("picture_time", "-", "s", "of the picture, by the simulation's clock", True),
    ),
)  # fmt: skip


def write_fields(path: Path, values: Mapping[str, Any]) -> None:
    """Write fields.h5 from SCHEMA's variables and attributes by name."""
    SCHEMA.write(path, values)


def read_fields(path: Path) -> xr.Dataset:
    """SCHEMA's variables. StageError in one sentence where the file is of no use."""
    return SCHEMA.read(path)
