"""piv render sheet.h5 -o images.h5: a plane series as a camera would see it."""

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from piv.files.settings import add_fields, add_paths, build, run_with
from piv.foreign.read import open_vectors
from piv.images.open_recording import open_recording
from piv.synthetic.camera import Camera, Seeding
from piv.synthetic.render_recording import render_recording


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Flags of the subcommand."""
    add_paths(parser, "recording to write (.h5)", "plane series (.h5) to render")
    add_fields(parser, Camera)
    add_fields(parser, Seeding)
    parser.add_argument(
        "--origin-px",
        nargs=2,
        type=float,
        metavar=("X", "Y"),
        default=argparse.SUPPRESS,
        help="tank origin, px right and up from the bottom left pixel "
        "(default: the plane's middle is the picture's)",
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


def make(
    source: str | Path,
    output: str | Path,
    settings: dict[str, Any],
    *,
    threads: int = 1,
    quiet: bool = False,
) -> None:
    """Render the plane series `source` into the recording `output`.

    `settings`: the flags by name; ValueError for other keys. One thread renders, whatever
    `threads`.
    """
    camera, seeding = build(settings, Camera, Seeding, more=("seed", "truth"))
    with open_vectors(source) as series:
        path = render_recording(
            series,
            output,
            camera,
            seeding,
            seed=settings.get("seed", 0),
            truth=settings.get("truth", True),
            quiet=quiet,
        )
    if not quiet:
        with open_recording(path) as recording:
            rows, columns = recording.shape
            print(f"{path}: {len(recording)} frames of {columns} x {rows} px")


run = partial(run_with, make)
