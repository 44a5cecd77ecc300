"""Vorticity, divergence, strain, swirling strength and Q with propagated uncertainty."""

import argparse

from piv.fields.derived import QUANTITIES, derived, derived_blocks
from piv.fields.summary import summary
from piv.files.settings import add_paths
from piv.foreign.read import open_vectors
from piv.formats.plane_series import read_plane, write_plane
from piv.formats.plane_writer import write_blocks
from piv.formats.recording import window_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `piv derive`."""
    add_paths(parser, "the vectors with what is derived, .h5")
    parser.add_argument(
        "--quantities",
        nargs="+",
        choices=QUANTITIES,
        default=list(QUANTITIES),
        metavar="NAME",
        help=f"of {', '.join(QUANTITIES)} (default all)",
    )
    parser.add_argument(
        "--correlation-length",
        type=float,
        help="distance over which errors of neighbours are correlated, in the file's unit; 0: none "
        "(default: the correlation window that the file was made with, 0 where it does not say)",
    )


def run(args: argparse.Namespace) -> None:
    """Derive quantities of a series part by part, and write them."""
    with open_vectors(args.source) as series:
        length = window_of(series) if args.correlation_length is None else args.correlation_length
        names = tuple(args.quantities)
        if "time" in series["u"].dims:
            parts = derived_blocks(series, names, correlation_length=length)
            write_blocks(parts, args.output, series)
        else:
            write_plane(derived(series, names, correlation_length=length), args.output)
        unit, known = series["x"].attrs.get("units", "m"), "u_std" in series
    if args.quiet:
        return
    with read_plane(args.output) as plane:
        print(f"{args.output}: {', '.join(args.quantities)}; {summary(plane)}")
    if known:
        far = (
            f"correlated over {length:.3g} {unit}"
            if length
            else "too, for how they go together is not known: --correlation-length"
        )
        print(f"uncertainties: errors of u and v taken as independent, those of neighbours {far}")
