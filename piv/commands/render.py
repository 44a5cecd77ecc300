"""piv render sheet.h5 -o images.h5: a plane series as a camera would see it."""

from __future__ import annotations

import argparse
from dataclasses import fields

from fileio.formats.plane_series import read_plane
from piv.commands.settings import add_fields, add_settings, build, existing, merged
from piv.images.open_recording import open_recording
from piv.synthetic.camera import Camera, Seeding
from piv.synthetic.render_recording import render_recording


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Flags of the subcommand."""
    parser.add_argument("plane_series", help="plane series (.h5) to render")
    parser.add_argument("-o", "--output", required=True, help="recording to write (.h5)")
    add_fields(parser, Camera)
    add_fields(parser, Seeding)
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
        with open_recording(path) as recording:
            rows, columns = recording.shape
            print(f"{path}: {len(recording)} frames of {columns} x {rows} px")
