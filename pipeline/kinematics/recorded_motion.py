"""A finger's motion as a recording shows it (motion.h5, docs/formats.md): history and shapes for motion.source = "recording"."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from fileio.errors import StageError
from fileio.formats.bending_states import States, check_states
from fileio.hdf5 import open_netcdf
from pipeline.kinematics.pressure_law import PressureLaw, history_law

FORMAT = "recorded-motion"


def _open(path: Path) -> xr.Dataset:
    if not path.exists():
        raise StageError(
            f"{path}: motion.recording names no file; python -m postprocess.lab motion writes one from a recording"
        )
    try:
        dataset = open_netcdf(path, load=True)
    except ValueError as error:
        raise StageError(f"{error}; write it again") from None
    if dataset.attrs.get("format") != FORMAT:
        raise StageError(f"{path}: format is {dataset.attrs.get('format')!r}, expected {FORMAT!r}")
    missing = [
        n
        for n in ("time", "pressure", "state_pressure", "profile_x", "profile_y", "thickness")
        if n not in dataset.variables
    ]
    if missing:
        raise StageError(f"{path}: variable {missing[0]!r} is missing; write the file again")
    return dataset


def recorded_law(path: Path, factor: float) -> PressureLaw:
    """The history of the bending, as the pressure (Pa) of the same bend, times `factor` from its first value on."""
    with _open(path) as file:
        time, pressure = (file[name].values.astype(float) for name in ("time", "pressure"))
    if time.size < 3 or not (np.isfinite(time).all() and np.isfinite(pressure).all()):
        raise StageError(
            f"{path}: needs at least three instants of finite time and pressure; write the file again"
        )
    if not np.all(np.diff(time) > 0):
        raise StageError(f"{path}: times must increase; write the file again")
    return history_law(time, pressure[0] + factor * (pressure - pressure[0]))


def recorded_states(path: Path) -> States:
    """The shapes: lower-layer profiles over the pressure of the same bend."""
    with _open(path) as file:
        states = States(
            file["state_pressure"].values.astype(float),
            np.stack([file["profile_x"].values, file["profile_y"].values], axis=-1).astype(float),
            file["thickness"].values.astype(float),
        )
    check_states(states, path)
    return states
