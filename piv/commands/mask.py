"""Masks of a recording: from a polygon, moving outlines, or a dark body."""

import argparse
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy import ndarray
from tqdm import tqdm

from piv.files.atomic import write_bytes
from piv.files.hdf5 import open_netcdf
from piv.files.settings import at_least, positive
from piv.formats.recording import pixel_of
from piv.images.clock import INTERVAL_HELP, RATE_HELP, set_clock
from piv.images.file_names import PAIRINGS
from piv.images.masks import dark_body, outline_masks, polygon_mask, polygons_mask, read_polygon
from piv.images.open_recording import Recording, open_recording


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `piv mask`."""
    parser.add_argument("recording", nargs="+", help="images, folder, glob, video, .mraw or .h5")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        help="a folder: one PNG per frame, white = body; a .png: one for all frames (--polygon)",
    )
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument("--polygon", type=Path, help="CSV of corners x_px, y_px (y up)")
    kind.add_argument(
        "--outline", type=Path, help=".h5 with the variable outline (kinematics, plane series)"
    )
    kind.add_argument("--dark", action="store_true", help="find the dark body in every frame")
    parser.add_argument(
        "--scale-mm-per-px", type=positive, help="of --outline, where the recording has none"
    )
    parser.add_argument(
        "--origin", type=float, nargs=2, metavar=("X", "Y"), help="px, y up; of --outline"
    )
    parser.add_argument("--interval", type=float, help=f"{INTERVAL_HELP}; of --outline")
    parser.add_argument(
        "--rate", type=float, help=f"{RATE_HELP}; of --outline, where the recording has no times"
    )
    parser.add_argument(
        "--threshold", type=at_least(0), help="grey level of --dark (default: from each frame)"
    )
    parser.add_argument(
        "--smooth",
        type=at_least(1),
        default=6.0,
        help="px over which gaps between particles close (default 6)",
    )
    parser.add_argument(
        "--min-area",
        type=at_least(0),
        default=0.002,
        help="least body, fraction of the image (default 0.002)",
    )
    parser.add_argument(
        "--grow",
        type=at_least(0, int),
        default=3,
        help="margin round the dark body, px (default 3)",
    )


def run(args: argparse.Namespace) -> None:
    """Write the masks."""
    if args.min_area >= 1:
        raise ValueError(f"--min-area is a part of the picture, below 1, got {args.min_area:g}")
    with open_recording(args.recording) as recording:
        set_clock(recording, recording.pairing or PAIRINGS[0], args.interval, args.rate)
        if args.output.suffix.lower() == ".png":
            if args.polygon is None:
                raise ValueError(
                    f"{args.output}: a moving mask is a folder of images; give a folder"
                )
            still = polygon_mask(read_polygon(args.polygon), recording.shape)
            _save(still, args.output)
            if not args.quiet:
                print(f"{args.output}: {still.mean():.1%} of the picture masked")
            return
        mask = _masks(args, recording)
        args.output.mkdir(parents=True, exist_ok=True)
        part = []
        for i in tqdm(range(len(recording)), desc="masks", disable=args.quiet or None):
            hidden = mask(i)
            part.append(float(hidden.mean()))
            _save(hidden, args.output / f"mask_{i:06d}.png")
        if not args.quiet:
            spread = (
                f"{min(part):.1%} to {max(part):.1%}"
                if max(part) - min(part) > 5e-4
                else f"{part[0]:.1%}"
            )
            print(f"{args.output}: {len(part)} masks, {spread} of the picture masked")


def _masks(args: argparse.Namespace, recording: Recording) -> Callable[[int], ndarray]:
    if args.dark:

        def dark(i: int) -> ndarray:
            try:
                return dark_body(
                    recording.frame(i),
                    threshold=args.threshold,
                    smooth_px=args.smooth,
                    min_area=args.min_area,
                    grow_px=args.grow,
                )
            except ValueError as error:
                raise ValueError(f"{recording.name}: frame {i}: {error}") from None

        return dark
    if args.outline is None:
        still = polygon_mask(read_polygon(args.polygon), recording.shape)
        return lambda i: still
    scale = args.scale_mm_per_px
    pixel = scale * 1e-3 if scale else pixel_of(recording.attrs)
    origin = args.origin or [recording.attrs.get(f"origin_{k}_px") for k in "xy"]
    if pixel is None or None in origin:
        raise ValueError(
            f"{recording.name}: no scale or origin in it; give --scale-mm-per-px and --origin"
        )
    if recording.times is None:
        raise ValueError(f"{recording.name}: no times in it; give --interval or --rate")
    with open_netcdf(args.outline) as series:
        bodies = outline_masks(series, recording.times, pixel, (origin[0], origin[1]))
    return lambda i: polygons_mask(bodies[i], recording.shape)


def _save(mask: ndarray, path: Path) -> None:
    write_bytes(path, cv2.imencode(".png", mask.astype(np.uint8) * 255)[1].tobytes())
