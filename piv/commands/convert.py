"""Vectors of other programs to plane series, and plane series to what others open."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from piv.fields.summary import summary
from piv.files.settings import at_least, positive
from piv.foreign.read import read_vectors
from piv.foreign.write import write_vectors
from piv.formats.plane_series import OUTLIER, VECTORS
from piv.images.clock import INTERVAL_HELP, RATE_HELP


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `piv convert`."""
    parser.add_argument(
        "input", nargs="+", help="vector files, one per instant, or one plane series"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        help=".h5 or .nc (the same), .csv, .mat, .vti",
    )
    add_reading(parser)
    for name in ("u", "v"):
        parser.add_argument(
            f"--{name}-limits",
            type=float,
            nargs=2,
            metavar=("LOW", "HIGH"),
            help=f"vectors with {name} outside are outliers, in the unit of the result",
        )


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Options of how other programs' vectors are read."""
    parser.add_argument("--length-unit", help="m, cm, mm, um or px, where the file does not say")
    parser.add_argument(
        "--velocity-unit", help="m/s, mm/s, px/frame, ..., where the file does not say"
    )
    parser.add_argument(
        "--y-axis", choices=("up", "down"), help="direction of y and of positive v in the file"
    )
    parser.add_argument("--scale-mm-per-px", type=positive)
    parser.add_argument("--interval", type=positive, help=INTERVAL_HELP)
    parser.add_argument("--rate", type=positive, help=f"{RATE_HELP}, of a series without times")
    parser.add_argument(
        "--image-rows",
        type=at_least(1, int),
        help="height of the image, for px that count downwards",
    )
    parser.add_argument(
        "--zero-is-absent", action="store_true", help="vectors of exactly (0, 0) are masked"
    )


def reading(args: argparse.Namespace) -> dict[str, Any]:
    """Those options as `read_vectors` takes them."""
    return {
        "rate": args.rate,
        "zero_is_absent": args.zero_is_absent,
        "length_unit": args.length_unit,
        "velocity_unit": args.velocity_unit,
        "y_axis": args.y_axis,
        "scale_mm_per_px": args.scale_mm_per_px,
        "interval": args.interval,
        "image_rows": args.image_rows,
    }


def run(args: argparse.Namespace) -> None:
    """Convert vectors from one format to another."""
    plane = read_vectors(args.input, **reading(args))
    plane = limited(plane, {n: getattr(args, f"{n}_limits") for n in ("u", "v")})
    files = write_vectors(plane, args.output)
    if not args.quiet:
        print(f"{files[0]}{f' ... {files[-1].name}' if len(files) > 1 else ''}: {summary(plane)}")


def limited(plane: xr.Dataset, limits: dict[str, list[float] | None]) -> xr.Dataset:
    """The plane with vectors outside the limits of their components as outliers."""
    out = np.zeros(plane["u"].shape, bool)
    for name, ends in limits.items():
        if ends is not None:
            low, high = ends
            if not low < high:
                raise ValueError(f"--{name}-limits are LOW HIGH, got {low:g} {high:g}")
            out |= (plane[name].values < low) | (plane[name].values > high)
    if not out.any():
        return plane
    absent = {n: np.nan for n in VECTORS if n in plane} | {"valid": 0, "flag": OUTLIER}
    return plane.assign({n: plane[n].where(~out, v) for n, v in absent.items() if n in plane})
