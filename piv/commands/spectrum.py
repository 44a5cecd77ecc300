"""Power spectral densities in time at points, or along x or y, as CSV (Lomb-Scargle)."""

import argparse

from piv.fields.spectra import space_spectrum, time_spectrum
from piv.files.atomic import write_text
from piv.files.settings import add_paths
from piv.foreign.read import open_vectors
from piv.formats.plane_series import units_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `piv spectrum`."""
    add_paths(parser, ".csv")
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument("--point", type=float, nargs=2, action="append", metavar=("X", "Y"),
                      help="in time, at the nearest vector; several are averaged")  # fmt: skip
    kind.add_argument(
        "--along", choices=("x", "y"), help="in space, averaged over all lines and instants"
    )
    parser.add_argument(
        "--segments", type=int, help="equal parts of the time, averaged; with --point (default 1)"
    )


def run(args: argparse.Namespace) -> None:
    """Write frequency, psd_u, psd_v and the number of records averaged."""
    if args.along and args.segments is not None:
        raise ValueError("--segments are parts of the time: they go with --point, not with --along")
    with open_vectors(args.source) as series:
        length, velocity = units_of(series)
        if args.along:
            table, per = space_spectrum(series, args.along), length
        else:
            segments = 1 if args.segments is None else args.segments
            table = time_spectrum(series, [(x, y) for x, y in args.point], segments)
            per = str(series["time"].attrs.get("units", "s"))
    head = f"# frequency: cycles per {per}; psd: ({velocity})² {per}, one-sided; Lomb-Scargle\n"
    write_text(
        args.output, head + table.to_csv(index=False, float_format="%.9g", lineterminator="\n")
    )
    if not args.quiet:
        peak = table.loc[(table["psd_u"] + table["psd_v"]).idxmax()]
        print(
            f"{args.output}: {len(table)} frequencies up to {table['frequency'].iloc[-1]:.3g} "
            f"cycles per {per}, "
            f"{table['averaged'].iloc[0]} records averaged; the peak is at {peak['frequency']:.4g}"
        )
