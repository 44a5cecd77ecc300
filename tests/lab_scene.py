"""A laboratory for the tests: the finger's kinematics, an analytic flow around it, pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pipeline.formats.kinematics import Kinematics, read_kinematics, write_kinematics
from pipeline.kinematics.stage import kinematics_values
from pipeline.scene.scene import load_scene
from piv.foreign.write import write_vectors
from piv.formats.plane_series import make_plane
from postprocess.lab.silhouette import left_of
from tests.conftest import CASES

# dpiv.toml of pictures and of vectors: TOML by key
PICTURES = {
    "format": '"dpiv"',
    "format_version": "4",
    "title": '"a recording"',
    "kind": '"pictures"',
    "files": '"a.h5"',
    "frame_rate_hz": "50.0",
    "start": '"from motion"',
    "finger_geometry": '"measured"',
    "finger_length_std_mm": "0.0",
    "scale": "{ scale_mm_per_px = 0.4, std_percent = 1.0 }",
    "axes": '{ y = "up", root_px = [150.0, 270.0] }',
    "piv": '{ window = 24, spacing = 8, pairing = "1-2,3-4", interval_s = 0.002 }',
}
VECTORS = {k: v for k, v in PICTURES.items() if k != "finger_length_std_mm"} | {
    "kind": '"vectors"',
    "files": '"v.h5"',
    "start": "{ at_s = 0.05, std_s = 0.001 }",
    "scale": "{ scale_mm_per_px = 0.25, std_percent = 0.5 }",
    "axes": '{ y = "up", root_mm = [20.0, 15.0], root_std_mm = 0.3, turn_std_deg = 0.5 }',
    "piv": "{ window = 24, spacing = 8, interval_s = 0.002 }",
    "vectors": "{ std_px = 0.05 }",
}
CASE = CASES / "single_finger"


def finger_kinematics(folder: Path, overrides: dict[str, Any] | None = None) -> Kinematics:
    """The motion of single_finger."""
    path = folder / "kinematics.h5"
    write_kinematics(path, kinematics_values(load_scene(CASE, "smoke", overrides)))
    return read_kinematics(path)


def state(folder: Path, keys: dict[str, str]) -> Path:
    """A folder with a dpiv.toml of these keys."""
    folder.mkdir(exist_ok=True)
    (folder / "dpiv.toml").write_text("".join(f"{k} = {v}\n" for k, v in keys.items()))
    return folder


def state_vectors(plane: xr.Dataset, folder: Path, root=(20.0, 15.0), **more: str) -> Path:
    """A folder of vectors with their dpiv.toml; `root` (mm) in the plane's axes."""
    rate = f"{1 / float(plane['time'][1] - plane['time'][0]):g}"
    axes = VECTORS["axes"].replace("20.0, 15.0", f"{root[0]!r}, {root[1]!r}")
    state(folder, VECTORS | {"frame_rate_hz": rate, "axes": axes} | more)
    write_vectors(plane, folder / "v.h5")
    return folder


def inside_sum(integral: np.ndarray, outline: np.ndarray, mean: float = 0.0) -> float:
    """Sum of the evidence inside a counter-clockwise outline (point, 2) px."""
    after = np.roll(outline, -1, axis=0)
    return sum(left_of(integral, mean, *a, *b) for a, b in zip(outline, after, strict=True))


def vortex_series(
    kinematics: Kinematics, times: np.ndarray, *, gain: float = 1.0, spacing: float = 1e-3
) -> xr.Dataset:
    """A tank-frame series: a Lamb-Oseen vortex at the dorsal side of the tip."""
    import shapely

    x, y = np.arange(-0.085, 0.125, spacing), np.arange(0.10, 0.285, spacing)
    gx, gy = np.meshgrid(x, y)
    names = ("outline", "tip", "tip_direction", "dorsal_direction", "bend")
    pressures = kinematics.law(np.clip(times, *kinematics.time))
    shapes = {n: np.array([kinematics.shape(n, p) for p in pressures])[:, None] for n in names}
    u, v, valid = [], [], []
    for k, t in enumerate(times):
        centre = shapes["tip"][k, 0] + 0.016 * shapes["dorsal_direction"][k, 0]
        dx, dy = gx - centre[0], gy - centre[1]
        r2 = np.maximum(dx**2 + dy**2, 1e-12)
        swirl = -gain * 0.012 * (0.3 + t) / (2 * np.pi * r2) * (1 - np.exp(-r2 / 0.006**2))
        outside = ~shapely.contains_xy(shapely.Polygon(shapes["outline"][k, 0]), gx, gy)
        u.append(np.where(outside, -swirl * dy, np.nan))
        v.append(np.where(outside, swirl * dx, np.nan))
        valid.append(outside)
    out = make_plane(x, y, np.array(u), np.array(v), time=times, valid=np.array(valid), **shapes)
    return out.assign_attrs(tip_width=kinematics.tip_width)
