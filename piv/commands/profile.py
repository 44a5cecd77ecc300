"""Vectors along a line, or the circulation over the distance from a point, as CSV."""

import argparse

import numpy as np
import pandas as pd
import xarray as xr

from piv.fields.circles import around
from piv.fields.lines import along_line
from piv.files.atomic import whole
from piv.files.settings import add_paths
from piv.foreign.read import open_vectors
from piv.formats.plane_series import circulation_unit, units_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `piv profile`."""
    add_paths(parser, ".csv")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument(
        "--line",
        type=float,
        nargs=4,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="from and to, in the file's unit, y up",
    )
    where.add_argument(
        "--around",
        type=float,
        nargs=2,
        metavar=("X", "Y"),
        help="circulation and swirl on circles about this point",
    )
    parser.add_argument("--radius", type=float, help="of the largest circle (default: that fits)")
    parser.add_argument(
        "--points", type=int, help="on the line, or circles (default: one per grid step)"
    )


def run(args: argparse.Namespace) -> None:
    """Write the profiles of all instants, one below the other."""
    if args.line and args.radius:
        raise ValueError("--radius belongs to --around; leave it out of a line")
    with open_vectors(args.source) as series:
        length, velocity = units_of(series)
        if args.line:
            x0, y0, x1, y1 = args.line
            tables = iter([_table(along_line(series, (x0, y0), (x1, y1), args.points))])
            name, unit, about = (
                "u",
                velocity,
                f"points on {np.hypot(x1 - x0, y1 - y0):.4g} {length}",
            )
        else:
            tables = around(series, tuple(args.around), args.radius, args.points)
            name, unit, about = "circulation", circulation_unit(length), "circles"
        rows = known = 0
        largest = 0.0
        with whole(args.output) as part, part.open("w", encoding="utf-8") as file:
            for k, table in enumerate(tables):
                table.to_csv(
                    file, index=False, header=k == 0, float_format="%.9g", lineterminator="\n"
                )
                values = _size(table)
                rows, known = rows + len(table), known + int(values.count())
                largest = max(largest, float(values.max()) if values.count() else 0.0)
    if not args.quiet:
        print(
            f"{args.output}: {rows} {about}, {known / rows:.1%} valid, largest |{name}|"
            f" {largest:.3g} {unit}"
        )


def _table(line: xr.Dataset) -> pd.DataFrame:
    """Rows of time (of a series), s, x, y and the fields, every instant below the other."""
    first = [*line["u"].dims[:-1], "s", "x", "y"]
    return line.to_dataframe(line["u"].dims).reset_index()[[*first, *map(str, line.data_vars)]]


def _size(table: pd.DataFrame) -> pd.Series:
    """What the command prints the largest of."""
    if "circulation" in table:
        return table["circulation"].abs()
    return pd.Series(np.hypot(table["u"], table["v"]))
