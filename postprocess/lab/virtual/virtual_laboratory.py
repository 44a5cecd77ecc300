"""A virtual laboratory: a recording rendered from a run, with known errors of set-up.

It writes recording.h5, a dpiv.toml as of a laboratory, and truth.json, which no code reads.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr

from fileio.atomic import write_text
from piv.synthetic.camera import Camera, Seeding
from postprocess.lab.data.pose import Pose
from postprocess.lab.virtual.virtual_experiment import virtual_recording

PAIRS_HZ, EXPOSURES_HZ = 100.0, 500.0  # of pairs, and of the two pictures of each


@dataclass(frozen=True)
class SetUp:
    """A laboratory whose set-up differs from what its dpiv.toml states.

    `camera` has the stated scale and place of the tank's origin. The finger is `shift_mm` off and
    turned by `turn_deg` about its root, the true scale is (1 + `scale_error`) times the stated one,
    and the first picture is taken at `start` (s) of the simulation, the last before `end`.
    """

    camera: Camera
    seeding: Seeding = field(default_factory=Seeding)
    shift_mm: tuple[float, float] = (1.0, 0.5)
    turn_deg: float = 2.0
    scale_error: float = 0.01
    start: float = 0.007
    end: float | None = None
    seed: int = 1

    def pose(self, root: tuple[float, float]) -> Pose:
        """Where the tank frame truly lies in the picture, turned about `root` (m)."""
        shifted = np.asarray(root) + np.asarray(self.shift_mm) * 1e-3
        at = np.asarray(self.camera.origin_px) + shifted / self.camera.pixel
        turn = float(np.radians(self.turn_deg))
        scale = self.camera.scale_mm_per_px * (1 + self.scale_error)
        return Pose(scale, turn, root, (at[0], at[1]))


def make_recording(
    sheet: xr.Dataset, set_up: SetUp, root: tuple[float, float], folder: Path, pairs_hz: float
) -> Path:
    """Write recording.h5, pairs of pictures, and truth.json; returns the recording."""
    last = float(sheet["time"][-1]) if set_up.end is None else set_up.end
    first = max(set_up.start, float(sheet["time"][0]))
    interval = 1 / set_up.camera.frame_rate_hz
    begin = first + np.arange(int((last - first - interval) * pairs_hz + 1e-6) + 1) / pairs_hz
    times = np.column_stack([begin, begin + interval]).ravel()
    pose, path = set_up.pose(root), folder / "recording.h5"
    at = pose, set_up.camera, set_up.seeding, times, path
    virtual_recording(sheet, *at, paired=True, seed=set_up.seed)
    truth = asdict(set_up) | {"pose": asdict(pose), "first_frame_s": first}
    write_text(folder / "truth.json", json.dumps(truth, indent=1, default=str))
    return path


TOML = """# A virtual laboratory, rendered from {run}: what its staff believes. The truth is in
# truth.json, which no part of the comparison reads.
format = "dpiv"
format_version = 3
title = "Virtual laboratory, {run}"
kind = "pictures"
files = "recording.h5"
frame_rate_hz = {rate}
start = "from motion"
sheet_thickness_mm = {sheet}
finger_geometry = "measured"   # the finger of the run is that of the scene's states
finger_length_std_mm = 0.0

[scale]
scale_mm_per_px = {scale}
std_percent = 1.0

[axes]
y = "up"
root_px = [{x:.2f}, {y:.2f}]

[piv]
window = 24
spacing = 8
pairing = "1-2,3-4"
interval_s = {interval!r}
"""


def write_dpiv(
    set_up: SetUp, root: tuple[float, float], folder: Path, run: str, pairs_hz: float
) -> None:
    """The dpiv.toml that the laboratory would write."""
    camera = set_up.camera
    x, y = np.asarray(camera.origin_px) + np.asarray(root) / camera.pixel
    sheet, interval = set_up.seeding.sheet_thickness * 1e3, 1 / camera.frame_rate_hz
    values = {"scale": camera.scale_mm_per_px, "x": x, "y": y, "sheet": sheet, "interval": interval}
    write_text(folder / "dpiv.toml", TOML.format(run=run, rate=pairs_hz, **values))


def camera_for(
    root: tuple[float, float],
    columns: int = 640,
    scale_mm_per_px: float = 0.25,
    rate: float = EXPOSURES_HZ,
) -> Camera:
    """A 5:4 camera that sees a hanging finger from its root to where it bends."""
    rows = columns * 4 // 5
    middle = np.array([root[0] + 0.020, root[1] - 0.055])
    origin = np.array([(columns - 1) / 2, (rows - 1) / 2]) - middle / (scale_mm_per_px * 1e-3)
    return Camera(columns, rows, scale_mm_per_px, (float(origin[0]), float(origin[1])), rate)
