"""Pressure of the water from vectors over time, and its loads on outlines in the sheet.

Holds where the flow does not cross the light sheet: in a symmetry plane, or a flow in two
dimensions. Elsewhere p is wrong without a trace. Needs fields close in time: a body or vortex moves
by less than a fifth of its size from one to the next.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from tqdm import tqdm

from piv.files.settings import add_paths, run_with
from piv.foreign.read import open_vectors
from piv.formats.plane_series import Planes, fields_of
from piv.formats.plane_writer import write_blocks
from piv.momentum.pressure import REFERENCE, WATER, Balance, values_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `piv pressure`."""
    add_paths(parser, "the vectors with p, p_std and the loads, .h5")
    parser.add_argument(
        "--density", type=float, default=WATER[0], help="kg/m³ (default %(default)s, of water)"
    )
    parser.add_argument(
        "--viscosity",
        type=float,
        default=WATER[1],
        help="kinematic, m²/s (default %(default)s, of water)",
    )
    parser.add_argument(
        "--about",
        type=float,
        nargs=2,
        default=(0.0, 0.0),
        metavar=("X", "Y"),
        help="point of the moment on the outline, m (default 0 0)",
    )


def run(args: argparse.Namespace) -> None:
    """Call `make` with the flags of a command line."""
    run_with(make, args)


def make(source: Path, output: Path, settings: dict[str, Any], *, quiet: bool = False) -> None:
    """Write the series `source` with its pressure to `output`."""
    settings = {**settings, "about": tuple(settings["about"])}
    p_std, largest, outside = [], 0.0, 0
    with open_vectors(source) as series:
        count, planes = series.sizes.get("time", 1), Planes(series[fields_of(series)])
        balance = Balance(series, **settings)

        def parts() -> Iterator[xr.Dataset]:
            nonlocal outside, largest
            for k in tqdm(range(count), "pressure", disable=quiet or None):
                found = balance.at(k)
                outside += bool(np.isnan(found.get("line_moment", 0.0)).any())
                if np.isfinite(found["p"]).any():
                    p_std.append(np.nanmedian(found["p_std"]))
                    largest = max(largest, float(np.nanmax(np.abs(found["p"]))))
                new = {name: values_of(name, values[None]) for name, values in found.items()}
                yield planes[k].expand_dims("time").assign(new)

        write_blocks(parts(), output, series.assign_attrs(series.attrs | balance.attributes))
        known, outlines = "u_std" in series, "outline" in series
    if quiet:
        return
    print(
        f"{output}: p up to {largest:.3g} Pa ({REFERENCE}), standard uncertainty median"
        f" {np.median(p_std):.2g} Pa{'; loads on the outline' if outlines else ''}"
    )
    if outside:
        print(f"no loads at {outside} of {count} instants: the outline leaves the vectors")
    if not known:
        print("the vectors' uncertainty is not known: taken from their scatter in time")
    print("p holds where the flow does not cross the light sheet, as in a plane of symmetry")
