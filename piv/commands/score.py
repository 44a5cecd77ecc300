"""Vectors of any program against the exact truth of their recording, in one table.

TRUTH is a plane series, as piv render writes beside a recording and as the benchmark holds. The
vectors' axes have the truth's origin: the centre of the bottom left pixel in the benchmark.
"""

import argparse
from pathlib import Path

import pandas as pd
import xarray as xr

from piv.commands.convert import add_reading, reading
from piv.files.atomic import write_text
from piv.files.settings import positive
from piv.foreign.read import read_vectors
from piv.formats.plane_series import read_plane
from piv.synthetic.score import score


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `piv score`."""
    parser.add_argument(
        "vectors", nargs="+", help="a series of vectors, or the files of another program in order"
    )
    parser.add_argument("--truth", type=Path, required=True, help="the exact flow, NetCDF-4")
    parser.add_argument("-o", "--output", type=Path, help="the table as .csv, too")
    parser.add_argument("--scale", type=positive, help="smoothing length of vortices, m")
    add_reading(parser)


def run(args: argparse.Namespace) -> None:
    """Print the table, and write it with -o."""
    with read_plane(args.truth) as truth:
        found = score(_vectors(args, truth), truth.load(), scale=args.scale)
    table = pd.DataFrame({"measure": found.keys(), "value": found.values()})
    if args.output:
        write_text(args.output, table.to_csv(index=False, float_format="%.6g"))
    if not args.quiet:
        print(table.to_string(index=False, header=False, float_format="%.4g"))


def _vectors(args: argparse.Namespace, truth: xr.Dataset) -> xr.Dataset:
    """The vectors in SI; what their files do not say of scale and clock is the truth's."""
    known = {n: truth.attrs.get(n) for n in ("scale_mm_per_px", "interval", "image_rows")}
    if truth.sizes.get("time", 1) > 1:
        known["rate"] = 1 / float(truth["time"][1] - truth["time"][0])
    vectors = read_vectors(args.vectors, **reading(args), assumed=known).load()
    if vectors["x"].attrs.get("units") == "px":
        raise ValueError(
            f"{args.vectors[0]}: is in px, and the truth states neither scale nor interval; give"
            " --scale-mm-per-px and --interval"
        )
    return vectors
