"""Exported vectors in metres, y up, with their uncertainty, and the virtual camera before them."""

from __future__ import annotations

import glob
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from fileio.errors import StageError
from fileio.json_text import natural_key
from piv.foreign.read import read_own, read_vectors
from piv.images.calibration import Calibration, calibrate_plane
from postprocess.lab.data.dpiv_toml import NAME, Dpiv, LabCamera, VectorFiles
from postprocess.lab.data.pose import Pose


def camera_before(data: xr.Dataset, pose: Pose, camera: LabCamera) -> tuple[Pose, np.ndarray]:
    """Pose (px) of a camera with the vectors in its middle, and its bottom left pixel (m).

    The pixel is in the vectors' frame.
    """
    scale = camera.scale_mm_per_px * 1e-3
    middle = np.array([data[axis].values[[0, -1]].mean() for axis in ("x", "y")])
    corner = middle - 0.5 * scale * np.array([camera.columns - 1, camera.rows - 1])
    at = (np.asarray(pose.at_px) * pose.pixel - corner) / scale
    seen = replace(pose, scale_mm_per_px=camera.scale_mm_per_px, at_px=tuple(at.tolist()))
    return seen, corner


def vectors_view(dpiv: Dpiv, pose: Pose) -> tuple[tuple[float, float], tuple[float, float]]:
    """Lower left and upper right corner (stated m) of the vectors and of the camera before them."""
    plane = lab_vectors(dpiv)
    step = float(plane["x"][1] - plane["x"][0])
    low = np.array([plane["x"].values[0], plane["y"].values[0]]) - step
    high = np.array([plane["x"].values[-1], plane["y"].values[-1]]) + step
    if isinstance(dpiv.camera, LabCamera):
        c = dpiv.camera
        size, middle = c.scale_mm_per_px * 1e-3 * np.array([c.columns, c.rows]), low + high
        low, high = np.minimum(low, 0.5 * (middle - size)), np.maximum(high, 0.5 * (middle + size))
    return (float(low[0]), float(low[1])), (float(high[0]), float(high[1]))


def lab_vectors(dpiv: Dpiv) -> xr.Dataset:
    """Exported vectors as a plane series in stated metres, y up, times from the first instant."""
    stated, interval = dpiv.vectors or VectorFiles(), dpiv.interval
    paths = _sorted_paths(dpiv)
    scale = dpiv.scale.pixel
    own = read_own(paths[0]) if stated.kind in (None, "plane", "csv") else None
    if own is not None and dpiv.axes.y == "down":
        text = 'in files of this kind y is up; state axes.y = "up" in dpiv.toml'
        raise StageError(f"{paths[0]}: {text}")
    try:
        if own is None:
            plane = read_vectors(
                paths,
                **stated.model_dump(exclude={"std_px"}),
                rate=dpiv.frame_rate_hz,
                y_axis=dpiv.axes.y,
                scale_mm_per_px=dpiv.scale.scale_mm_per_px,
                interval_s=interval,
            )
        else:
            plane = _in_metres(own, dpiv)
    except ValueError as error:  # piv asks by the names of its options
        raise StageError(re.sub(r"--([a-z-]+)", _key_of_option, str(error))) from None
    if "time" not in plane.dims:
        raise StageError(f"{paths[0]}: one instant is no motion; give the files of a series")
    plane = plane.load()
    rate = 1 / float(np.mean(np.diff(plane["time"].values)))
    if abs(rate / dpiv.frame_rate_hz - 1) > 0.01:
        raise StageError(
            f"{dpiv.folder / NAME}: frame_rate_hz is {dpiv.frame_rate_hz:g}, but {paths[0]} holds"
            f" {rate:.4g} fields per second; correct the one that is wrong"
        )
    if dpiv.axes.x == "left":
        mirrored = -plane["u"].values[..., ::-1]
        plane = plane.isel(x=slice(None, None, -1)).assign_coords(x=-plane["x"].values[::-1])
        plane = plane.assign(u=(plane["u"].dims, mirrored))
    if "u_std" not in plane:
        if stated.std_px is None:
            raise StageError(
                f"{paths[0]}: the vectors carry no uncertainty; give vectors.std_px in dpiv.toml,"
                " the standard uncertainty of a displacement in px"
            )
        std = np.full(plane["u"].shape, stated.std_px * scale / interval)
        plane = plane.assign(u_std=(plane["u"].dims, std), v_std=(plane["u"].dims, std))
    return plane.assign_coords(time=plane["time"].values - float(plane["time"][0]))


def _in_metres(plane: xr.Dataset, dpiv: Dpiv) -> xr.Dataset:
    """A plane series of this project in SI; without a calibration `piv correlate` writes px."""
    if plane["x"].attrs.get("units") != "px":
        return plane
    known = plane["time"].attrs.get("units") == "s"
    calibration = Calibration(dpiv.scale.pixel * 1e3)
    return calibrate_plane(plane, calibration, dpiv.interval, None if known else dpiv.frame_rate_hz)


def _key_of_option(option: re.Match[str]) -> str:
    """The key of dpiv.toml that an option of `piv convert` is."""
    name = option.group(1).replace("-", "_")
    keys = {
        "y_axis": "axes.y",
        "rate": "frame_rate_hz",
        "from": "vectors.kind",
        "interval": "piv.interval_s",
    }
    return keys.get(name, f"vectors.{name}")


def _sorted_paths(dpiv: Dpiv) -> list[Path]:
    """Vector files of a dpiv.toml; FileNotFoundError where a pattern matches none."""
    names = dpiv.sources()
    patterns = [names] if isinstance(names, str) else names
    matches = [Path(p) for pattern in patterns for p in glob.glob(pattern)]
    if not matches:
        raise FileNotFoundError(f"{patterns[0]}: no file matches; check files in dpiv.toml")
    return sorted(matches, key=natural_key)
