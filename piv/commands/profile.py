"""Vectors, and what is derived from them, along a line, as CSV."""

import argparse

import numpy as np

from piv.commands.settings import add_paths
from piv.fields.lines import along_line
from piv.files.atomic import whole
from piv.foreign.read import open_vectors
from piv.foreign.write import units_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `piv profile`."""
    add_paths(parser, ".csv")
    parser.add_argument(
        "--line",
        type=float,
        nargs=4,
        required=True,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="from and to, in the file's unit, y up",
    )
    parser.add_argument("--points", type=int, help="on the line (default: one per grid step)")


def run(args: argparse.Namespace) -> None:
    """Every instant below the other."""
    x0, y0, x1, y1 = args.line
    rows = speeds = 0
    largest = 0.0
    with open_vectors(args.source) as series:
        unit, velocity = units_of(series)
        tables = along_line(series, (x0, y0), (x1, y1), args.points)
        with whole(args.output) as part, part.open("w", encoding="utf-8") as file:
            for k, table in enumerate(tables):
                table.to_csv(
                    file, index=False, header=k == 0, float_format="%.9g", lineterminator="\n"
                )
                speed = np.hypot(table["u"], table["v"])
                rows, speeds = rows + len(table), speeds + int(speed.count())
                largest = max(largest, float(speed.max()) if speed.count() else 0.0)
    if not args.quiet:
        print(
            f"{args.output}: {rows} points on {np.hypot(x1 - x0, y1 - y0):.4g} {unit}, "
            f"{speeds / rows:.1%} valid, largest |u| {largest:.3g} {velocity}"
        )
