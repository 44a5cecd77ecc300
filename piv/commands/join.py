"""piv join piv.h5: the chunks of a recording (piv correlate --chunk k/n) to one plane series."""

import argparse

from piv.fields.summary import summary_of
from piv.sequence.chunks import join, parts_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Flags of the subcommand."""
    parser.add_argument("output", help="plane series to write (.h5); its chunks lie beside it")
    parser.add_argument("--keep", action="store_true", help="do not remove the chunks afterwards")


def run(args: argparse.Namespace) -> None:
    """Join, then remove the chunks."""
    parts = parts_of(args.output)
    path = join(parts, args.output)
    if not args.keep:
        for part in parts:
            part.unlink()
    if not args.quiet:
        print(summary_of(path))
