"""A virtual laboratory: a recording rendered from a run, with errors of set-up that are known.

Command: python -m postprocess.lab recording cases/single_finger --sheet sheet.h5 -o folder writes recording.h5, dpiv.toml as a
laboratory would give it, and truth.json, which nothing else reads.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr

from fileio.atomic import write_text
from fileio.formats.kinematics import read_kinematics
from fileio.formats.plane_series import read_plane
from piv.synthetic.camera import Camera, Seeding
from postprocess.lab.data.pose import Pose
from postprocess.lab.virtual.virtual_experiment import virtual_recording


@dataclass(frozen=True)
class SetUp:
    """The laboratory as it is, where its dpiv.toml says otherwise: SI but for the names that say so.

    `camera.origin_px` is where the dpiv.toml says that the tank's origin is, `camera.scale_m_per_px` the scale that it states.
    The finger is `shift_mm` off and turned by `turn_deg` about its root, the true scale is (1 + `scale_error`) times the stated
    one, and the first picture is taken at `start` (s) of the simulation.
    """

    camera: Camera
    seeding: Seeding = field(default_factory=Seeding)
    shift_mm: tuple[float, float] = (0.0, 0.0)
    turn_deg: float = 0.0
    scale_error: float = 0.0
    start: float = 0.0
    end: float | None = None
    seed: int = 1

    def pose(self, root: tuple[float, float]) -> Pose:
        """Where the tank frame truly lies in the picture; `root` (m): what it is turned about."""
        stated = self.camera.scale_m_per_px
        origin = np.asarray(self.camera.origin_px)
        at = origin + (np.asarray(root) + np.asarray(self.shift_mm) * 1e-3) / stated
        return Pose(
            stated * (1 + self.scale_error), float(np.radians(self.turn_deg)), root, (at[0], at[1])
        )


def make_recording(
    sheet: xr.Dataset,
    set_up: SetUp,
    root: tuple[float, float],
    folder: Path,
    pairs_hz: float | None = None,
) -> Path:
    """Write recording.h5 (frames only, as from a camera) and truth.json; returns the recording.

    `pairs_hz`: pairs of frames at this rate, each pair's two frames one interval of the camera apart; None: all frames.
    """
    last = float(sheet["time"][-1]) if set_up.end is None else set_up.end
    first = max(set_up.start, float(sheet["time"][0]))
    interval = 1 / set_up.camera.frame_rate_hz
    if pairs_hz is None:
        times = first + np.arange(int((last - first) / interval + 1e-6) + 1) * interval
    else:
        begin = first + np.arange(int((last - first - interval) * pairs_hz + 1e-6) + 1) / pairs_hz
        times = np.column_stack([begin, begin + interval]).ravel()
    pose = set_up.pose(root)
    path, paired = folder / "recording.h5", pairs_hz is not None
    virtual_recording(
        sheet, pose, set_up.camera, set_up.seeding, times, path, paired=paired, seed=set_up.seed
    )
    truth = asdict(set_up) | {"pose": asdict(pose), "first_frame_s": first}
    write_text(folder / "truth.json", json.dumps(truth, indent=1, default=str))
    return path


TOML = """# A virtual laboratory: rendered by postprocess.lab.virtual.virtual_laboratory from {run}. What is stated here is what its staff believes;
# what is true is in truth.json, which no part of the comparison reads.
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
window = {window}
spacing = {spacing}
{pairing}"""


def write_dpiv(
    set_up: SetUp,
    root: tuple[float, float],
    folder: Path,
    run: str,
    window: int,
    spacing: int,
    pairs_hz: float | None,
    every: int,
) -> None:
    """The dpiv.toml that the laboratory would write."""
    stated = set_up.camera.scale_m_per_px
    x, y = np.asarray(set_up.camera.origin_px) + np.asarray(root) / stated
    paired = f'pairing = "1-2,3-4"\ninterval_s = {1 / set_up.camera.frame_rate_hz!r}\n'
    text = TOML.format(
        run=run, rate=pairs_hz or set_up.camera.frame_rate_hz, sheet=set_up.seeding.sheet_thickness * 1e3, scale=stated * 1e3, x=x,
        y=y, window=window, spacing=spacing, pairing=paired if pairs_hz else f'pairing = "1-2,2-3"\nevery = {every}\n',
    )  # fmt: skip
    write_text(folder / "dpiv.toml", text)


def camera_for(
    root: tuple[float, float], columns: int, scale_m_per_px: float, rate: float
) -> Camera:
    """A 5:4 camera that sees a hanging finger from its root to where it bends."""
    rows = columns * 4 // 5
    middle = np.array([root[0] + 0.020, root[1] - 0.055])
    origin = np.array([(columns - 1) / 2, (rows - 1) / 2]) - middle / scale_m_per_px
    return Camera(columns, rows, scale_m_per_px, (float(origin[0]), float(origin[1])), rate)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command `recording`."""
    parser.add_argument(
        "case", type=Path, help="scene whose run is taken for the water, as cases/single_finger"
    )
    parser.add_argument("--level", default="smoke")
    parser.add_argument(
        "--sheet", type=Path, required=True, help="its sheet over more than the camera's view"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder to write")
    parser.add_argument("--shift-mm", nargs=2, type=float, default=(1.0, 0.5), metavar=("X", "Y"))
    parser.add_argument("--turn-deg", type=float, default=2.0)
    parser.add_argument("--scale-error", type=float, default=0.01)
    parser.add_argument(
        "--start", type=float, default=0.007, help="s of the run at the first picture"
    )
    parser.add_argument("--columns", type=int, default=640)
    parser.add_argument("--scale-mm-per-px", type=float, default=0.25)
    parser.add_argument("--density-ppp", type=float, default=0.05)
    parser.add_argument("--window", type=int, default=24)
    parser.add_argument("--spacing", type=int, default=8)
    parser.add_argument(
        "--pairs-hz", type=float, help="take pairs of pictures at this rate, not all pictures"
    )
    parser.add_argument(
        "--every", type=int, default=5, help="correlate one pair of pictures of so many"
    )
    parser.add_argument("--seed", type=int, default=1)


def run(args: argparse.Namespace) -> None:
    """Command `recording`."""
    kinematics = read_kinematics(args.case / "out" / args.level / "kinematics.h5")
    camera = camera_for(kinematics.root, args.columns, args.scale_mm_per_px * 1e-3, 500.0)
    set_up = SetUp(
        camera,
        Seeding(density_ppp=args.density_ppp),
        tuple(args.shift_mm),
        args.turn_deg,
        args.scale_error,
        args.start,
        seed=args.seed,
    )
    with read_plane(args.sheet) as sheet:
        make_recording(sheet.load(), set_up, kinematics.root, args.output, args.pairs_hz)
    name, window = args.case.name, args.window
    write_dpiv(
        set_up, kinematics.root, args.output, name, window, args.spacing, args.pairs_hz, args.every
    )
    print(args.output)
