"""The swept meshes of a run's cases, `sweep.h5`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from fileio.schema import Schema, variables

SCHEMA = Schema(
    "sweep",
    "delete it and run make again",
    (),
    variables("""
node  point  1  planform node of each mesh point
level  point  1  level of each mesh point, from the back wall
cell_column  cell  1  planform cell of each mesh cell
cell_layer  cell  1  layer of each mesh cell, from the back wall
"""),
)


def write_sweep(out: Path, cases: Mapping[str, Mapping[str, np.ndarray]]) -> None:
    """Write sweep.h5 of a level's folder: SCHEMA's variables of each case's mesh by its name."""
    SCHEMA.write(out / "sweep.h5", {}, cases)


def read_sweep(out: Path, case: str) -> xr.Dataset:
    """The mesh of one case of a level's sweep.h5, loaded."""
    return SCHEMA.read(out / "sweep.h5", case)
