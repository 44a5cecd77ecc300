"""piv correlate A.tif B.tif -o out.h5: images or a recording to a plane series of vectors."""

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from piv.correlation.options import Options
from piv.fields.summary import summary_of
from piv.files.settings import add_fields, run_with
from piv.images.image_files import COLOURS
from piv.images.recordings.double_frames import LAYOUTS
from piv.sequence.correlate import RecordingCamera, correlate_to
from piv.sequence.frame_sets import SequenceOptions


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Flags of the subcommand."""
    parser.add_argument(
        "source",
        nargs="+",
        help="two or more images, a folder, a glob, a video, .mraw/.cihx, .cine, .im7 or images.h5",
    )
    parser.add_argument("-o", "--output", required=True, help="plane series to write (.h5)")
    parser.add_argument(
        "--mask",
        metavar="FILE",
        help="polygon (.csv, px), image (not black = body), folder or pattern of one image per "
        "frame, "
        "or moving polygons (.json, .toml)",
    )
    parser.add_argument(
        "--roi",
        type=float,
        nargs=4,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="only this region, y up",
    )
    parser.add_argument(
        "--roi-unit", choices=("px", "m"), default="px", help="of --roi (default px)"
    )
    add_fields(parser, Options)
    add_fields(parser, SequenceOptions)
    parser.add_argument(
        "--chunk",
        metavar="K/N",
        help="only the K-th of N parts, into a file beside the output; then: piv join OUTPUT",
    )
    add_fields(parser, RecordingCamera)
    parser.add_argument(
        "--layout",
        choices=LAYOUTS,
        default=argparse.SUPPRESS,
        help="of pictures that hold both exposures of a pair",
    )
    parser.add_argument(
        "--colour",
        choices=COLOURS,
        default=argparse.SUPPRESS,
        help="how to make coloured images grey (default refuse)",
    )


def make(
    source: str | Path | list[str],
    output: str | Path,
    settings: dict[str, Any],
    *,
    threads: int = 1,
    quiet: bool = False,
) -> None:
    """Correlate the recording `source` into the plane series `output`.

    `settings`: the flags by name; ValueError for other keys. `threads` fields are computed at a
    time.
    """
    sources = [source] if isinstance(source, str | Path) else source
    path = correlate_to(sources, output, {"threads": threads} | settings, quiet=quiet)
    if not quiet:
        print(summary_of(path))


run = partial(run_with, make)
