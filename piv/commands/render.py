"""python -m piv render sheet.h5 -o images.h5: a plane series as a camera would see it."""

from __future__ import annotations

import argparse
import sys
from dataclasses import fields

from fileio.formats.plane_series import read_plane
from piv.commands.settings import add_fields, add_settings, build, existing, merged
from piv.synthetic.camera import Camera, Seeding
from piv.synthetic.render_recording import render_recording

HELPS = {
    "width_px": "picture width",
    "height_px": "picture height",
    "scale_m_per_px": "metres per pixel",
    "frame_rate_hz": "frames per second",
    "bits": "grey levels are 2**bits",
    "background": "grey level of the background",
    "read_noise": "standard deviation of the read noise, grey levels",
    "electrons_per_level": "electrons per grey level, for shot noise; 0 = none",
    "pairs_every": "take a pair of frames out of every so many (correlate them with --pairing 1-2,3-4); 1 = every frame",
    "density_ppp": "particles per pixel within the sheet",
    "diameter_px": "particle image diameter at 1/e^2",
    "diameter_std_px": "its standard deviation",
    "sheet_thickness": "thickness of the light sheet at 1/e^2, m",
    "peak": "peak of a mean particle, part of the grey scale",
    "shadow": "part of the light from below that the body takes away, 0 to 1",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Flags of the subcommand."""
    parser.add_argument("plane_series", help="plane series (.h5) to render")
    parser.add_argument("-o", "--output", required=True, help="recording to write (.h5)")
    add_fields(parser, Camera, HELPS)
    add_fields(parser, Seeding, HELPS)
    parser.add_argument(
        "--origin-px",
        nargs=2,
        type=float,
        metavar=("X", "Y"),
        default=argparse.SUPPRESS,
        help="tank origin in px, right and up from the bottom left pixel (default: the plane's middle is the picture's)",
    )
    parser.add_argument(
        "--seed", type=int, default=argparse.SUPPRESS, help="of all random numbers (default 0)"
    )
    parser.add_argument(
        "--truth",
        action=argparse.BooleanOptionalAction,
        default=argparse.SUPPRESS,
        help="write the exact truth beside (default yes)",
    )
    add_settings(parser)


def run(args: argparse.Namespace) -> None:
    """Render the recording."""
    known = {f.name for kind in (Camera, Seeding) for f in fields(kind)} | {"seed", "truth"}
    given = merged(args, known)
    if given.get("origin_px") is not None:
        given["origin_px"] = tuple(given["origin_px"])
    with read_plane(existing(args.plane_series)) as series:
        path = render_recording(
            series,
            args.output,
            build(Camera, given),
            build(Seeding, given),
            seed=int(given.get("seed", 0)),
            truth=bool(given.get("truth", True)),
            quiet=args.quiet,
        )
    if not args.quiet:
        print(path, file=sys.stdout)
