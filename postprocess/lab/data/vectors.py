"""A laboratory's vectors in metres, y up, with their uncertainty."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from fileio.errors import StageError
from piv.foreign.read import read_own
from piv.images.calibration import Calibration, calibrate_plane
from postprocess.lab.data.dpiv_toml import NAME, Dpiv


def vectors_view(dpiv: Dpiv) -> tuple[tuple[float, float], tuple[float, float]]:
    """Lower left and upper right corner (stated m) of the vectors and a spacing around them."""
    plane = lab_vectors(dpiv)
    x, y = plane["x"].values, plane["y"].values
    step = float(x[1] - x[0])
    return (float(x[0]) - step, float(y[0]) - step), (float(x[-1]) + step, float(y[-1]) + step)


def lab_vectors(dpiv: Dpiv) -> xr.Dataset:
    """A plane series in stated metres, y up, times from the first instant."""
    sources = dpiv.sources()
    path = Path(sources if isinstance(sources, str) else ", ".join(sources))
    plane = read_own(path) if path.is_file() else None
    if plane is None:
        why = "is no series of vectors" if path.exists() else "is missing (vectors are one file)"
        raise StageError(
            f"{path}: {why}; make one of your files by piv convert FILES -o vectors.h5, and state"
            f' files = "vectors.h5" in {NAME}'
        )
    if plane["x"].attrs.get("units") == "px":  # as piv correlate writes it without a calibration
        rate = None if plane["time"].attrs.get("units") == "s" else dpiv.frame_rate_hz
        plane = calibrate_plane(plane, Calibration(dpiv.scale.pixel * 1e3), dpiv.interval, rate)
    if "time" not in plane.dims:
        raise StageError(f"{path}: one instant is no motion; give a series")
    plane = plane.load()
    rate = 1 / float(np.mean(np.diff(plane["time"].values)))
    if abs(rate / dpiv.frame_rate_hz - 1) > 0.01:
        raise StageError(
            f"{dpiv.folder / NAME}: frame_rate_hz is {dpiv.frame_rate_hz:g}, but {path} holds"
            f" {rate:.4g} fields per second; correct the one that is wrong"
        )
    if dpiv.axes.x == "left":
        mirrored = -plane["u"].values[..., ::-1]
        plane = plane.isel(x=slice(None, None, -1)).assign_coords(x=-plane["x"].values[::-1])
        plane = plane.assign(u=(plane["u"].dims, mirrored))
    if "u_std" not in plane:
        if dpiv.vectors is None:
            raise StageError(
                f"{path}: the vectors carry no uncertainty; give vectors.std_px in dpiv.toml, the"
                " standard uncertainty of a displacement in px"
            )
        std = np.full(plane["u"].shape, dpiv.vectors.std_px * dpiv.scale.pixel / dpiv.interval)
        plane = plane.assign(u_std=(plane["u"].dims, std), v_std=(plane["u"].dims, std))
    return plane.assign_coords(time=plane["time"].values - float(plane["time"][0]))
