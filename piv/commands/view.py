"""A local page in the browser: images and vectors over time, masks, measures, settings to try."""

import argparse
from pathlib import Path

from piv.view.session import open_session


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `piv view`."""
    parser.add_argument(
        "file",
        nargs="+",
        help="vectors (.h5, .nc, ...), or images: two or more, folder, glob, video, .mraw or .h5",
    )
    parser.add_argument("--images", nargs="+", help="the recording behind the vectors")
    parser.add_argument("--mask", help="as of piv correlate, for pairs that are tried")
    parser.add_argument("-o", "--output", type=Path, default=Path("regions.json"),
                        help="masks and region that are drawn (default %(default)s)")  # fmt: skip
    parser.add_argument(
        "--port", type=int, default=5006, help="of the page, at 127.0.0.1 (default %(default)s)"
    )
    parser.add_argument("--no-browser", action="store_true", help="only say the address")


def run(args: argparse.Namespace) -> None:
    """Serve the page until Ctrl-C."""
    if not 1 <= args.port <= 65535:
        raise ValueError(f"--port is from 1 to 65535, got {args.port}")
    from piv.view.server import serve

    session = open_session(args.file, args.images, args.mask)
    session.extent()  # raises where the scale is unknown, before the page opens

    def ready(address: str) -> None:
        if not args.quiet or args.no_browser:
            print(f"{address}\n{session.count} steps; Ctrl-C ends it", flush=True)

    serve(session, args.output, args.port, not args.no_browser, ready)
