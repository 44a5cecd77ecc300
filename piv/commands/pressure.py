"""Pressure of the water from vectors over time, and its loads on outlines in the sheet.

Holds where the flow does not cross the light sheet: in a symmetry plane, or a flow in two
dimensions. Elsewhere p is wrong without a trace. Needs fields close in time: a body or vortex moves
by less than a fifth of its size from one to the next.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from fileio.formats.plane_series import FINGER_VARIABLES, VECTORS
from fileio.formats.plane_writer import writing_planes
from piv.commands.settings import add_paths, run_with
from piv.foreign.read import open_vectors
from piv.momentum.pressure import REFERENCE, WATER, attributes, pressures


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
        kept = [name for name in (*VECTORS, *FINGER_VARIABLES) if name in series]
        found = pressures(series, **settings)
        about = {k: v for k, v in series.attrs.items() if not k.startswith("format")}
        about |= attributes(series, **settings)
        times, axes = series["time"].values, (series["x"].values, series["y"].values)
        with writing_planes(output, *axes, len(times), about) as planes:
            bar = tqdm(found, "pressure", total=len(times), disable=quiet or None)
            for k, fields in enumerate(bar):
                one = series[kept].isel(time=k)
                own = {name: one[name].values for name in kept}
                grids = {n: f.astype(np.float32) for n, f in fields.items() if n[:5] in _GRIDS}
                planes.write(k, float(times[k]), {**own, **fields, **grids})
                outside += bool(np.isnan(fields.get("line_moment", 0.0)).any())
                p_std.append(np.nanmedian(fields["p_std"]))
                largest = max(largest, float(np.nanmax(np.abs(fields["p"]))))
        known, outlines = "u_std" in series, "outline" in series
    if quiet:
        return
    print(
        f"{output}: p up to {largest:.3g} Pa ({REFERENCE}), standard uncertainty median"
        f" {np.median(p_std):.2g} Pa{'; loads on the outline' if outlines else ''}"
    )
    if outside:
        print(f"no loads at {outside} of {len(times)} instants: the outline leaves the vectors")
    if not known:
        print("the vectors' uncertainty is not known: taken from their scatter in time")
    print("p holds where the flow does not cross the light sheet, as in a plane of symmetry")


_GRIDS = ("p", "p_std")
