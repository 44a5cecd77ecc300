"""Scale, origin and lens distortion: make a calibration file, or apply one to vectors or images."""

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np

from piv.fields.summary import summary_of
from piv.files.atomic import write_bytes
from piv.formats.plane_series import read_checked_plane, write_plane
from piv.images.calibration import (
    MODELS_HELP,
    Calibration,
    calibrate_plane,
    from_points,
    load_calibration,
    rectify_image,
    save_calibration,
)
from piv.images.clock import INTERVAL_HELP, RATE_HELP
from piv.images.open_recording import open_recording


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `piv calibrate`."""
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        help="calibration .json; with --apply the result",
    )
    make = parser.add_argument_group("make a calibration (one of the first three)")
    make.add_argument("--scale-mm-per-px", type=float)
    make.add_argument(
        "--points",
        type=float,
        nargs=4,
        metavar=("X1", "Y1", "X2", "Y2"),
        help="two points, px, y up",
    )
    make.add_argument("--target", choices=("chessboard", "charuco"))
    make.add_argument(
        "--origin",
        type=float,
        nargs=2,
        default=(0.0, 0.0),
        metavar=("X", "Y"),
        help="px, y up from the bottom row (default 0 0)",
    )
    make.add_argument("--distance-mm", type=float, help="between the two points")
    make.add_argument(
        "--images", nargs="+", help="pictures of the target; the first shows it in the light sheet"
    )
    make.add_argument("--rows", type=int, help="squares of the target, top to bottom")
    make.add_argument("--columns", type=int, help="squares of the target, left to right")
    make.add_argument("--square-mm", type=float)
    make.add_argument("--marker-mm", type=float, help="ChArUco only")
    make.add_argument(
        "--dictionary", default="DICT_4X4_1000", help="ArUco dictionary (default %(default)s)"
    )
    make.add_argument(
        "--lens", default="standard", choices=("standard", "rational"), help=MODELS_HELP
    )
    use = parser.add_argument_group("apply a calibration")
    use.add_argument("--apply", type=Path, metavar="JSON", help="calibration file")
    use.add_argument("--vectors", type=Path, help="plane (series) in px, .h5")
    use.add_argument("--interval", type=float, help=f"{INTERVAL_HELP}, where the file has none")
    use.add_argument("--rate", type=float, help=f"{RATE_HELP}, where the file has no times")
    use.add_argument("--image", help="an image to rectify")


def run(args: argparse.Namespace) -> None:
    """Make a calibration, or apply one to files."""
    wanted = (
        ".json" if args.apply is None else ".h5" if args.vectors else args.output.suffix.lower()
    )
    if args.output.suffix.lower() != wanted:
        raise ValueError(f"{args.output}: piv calibrate writes {wanted} here; name it so")
    if args.apply is not None:
        _apply(args)
        return
    ways = [args.scale_mm_per_px is not None, args.points is not None, args.target is not None]
    if sum(ways) != 1:
        raise ValueError("give exactly one of --scale-mm-per-px, --points, --target, or --apply")
    if args.target is not None:
        calibration = _from_target(args)
    elif args.points is not None:
        if args.distance_mm is None:
            raise ValueError("--points needs --distance-mm")
        x1, y1, x2, y2 = args.points
        calibration = from_points((x1, y1), (x2, y2), args.distance_mm, tuple(args.origin))
    else:
        calibration = Calibration(args.scale_mm_per_px, *args.origin)
    save_calibration(calibration, args.output)
    if not args.quiet:
        print(f"{args.output}: {calibration.scale_mm_per_px:.6g} mm/px")
        if calibration.lens is not None:
            lens = calibration.lens
            print(f"reprojection error {lens.reprojection_rms_px:.3f} px over {lens.views} views")


def _from_target(args: argparse.Namespace) -> Calibration:
    from piv.images.calibration_target import Target, calibrate_target

    for option in ("images", "rows", "columns", "square_mm"):
        if getattr(args, option) is None:
            raise ValueError(f"--target needs --{option.replace('_', '-')}")
    if args.target == "charuco" and args.marker_mm is None:
        raise ValueError("--target charuco needs --marker-mm")
    marker = args.marker_mm * 1e-3 if args.target == "charuco" else None
    target = Target(args.rows, args.columns, args.square_mm * 1e-3, marker, args.dictionary)
    with open_recording(args.images, colour="luma") as views:
        pictures = list(views)
    calibration, used = calibrate_target(
        pictures, target, model=args.lens, origin_px=tuple(args.origin)
    )
    if not args.quiet and len(used) < len(pictures):
        print(f"left out {len(pictures) - len(used)} of {len(pictures)} pictures: too few corners")
    return calibration


def _apply(args: argparse.Namespace) -> None:
    calibration = load_calibration(args.apply)
    if (args.vectors is None) == (args.image is None):
        raise ValueError("--apply needs either --vectors or --image")
    if args.image is not None:
        with open_recording(args.image) as recording:
            flat = rectify_image(np.asarray(recording.frame(0)), calibration)
        try:
            write_bytes(args.output, cv2.imencode(args.output.suffix, flat)[1].tobytes())
        except cv2.error:
            raise ValueError(
                f"{args.output}: cannot be written as an image; name it .png or .tif"
            ) from None
        if not args.quiet:
            print(f"{args.output}: {flat.shape[1]} x {flat.shape[0]} px")
        return
    with read_checked_plane(args.vectors) as plane:
        if plane["x"].attrs.get("units") != "px":
            raise ValueError(
                f"{args.vectors}: x is in {plane['x'].attrs.get('units')!r}, a calibration wants px"
            )
        calibrated = calibrate_plane(plane, calibration, args.interval, args.rate)
        write_plane(calibrated, args.output)
    if lost := [str(n) for n in plane.data_vars if n not in calibrated]:
        text = "through a lens the vectors alone are taken; left out"
        print(f"{args.output}: {text}: {', '.join(lost)}", file=sys.stderr)
    if not args.quiet:
        print(summary_of(args.output))
