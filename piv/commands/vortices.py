"""piv vortices piv.h5 -o vortices.csv: vortices of a plane series, and their tracks."""

import argparse
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from piv.files.settings import add_fields, add_paths, build, run_with
from piv.foreign.read import open_vectors
from piv.formats.plane_series import circulation_unit, units_of
from piv.formats.vortex_table import write_vortices
from piv.vortices.find import VortexSettings
from piv.vortices.table import tabulate_vortices
from piv.vortices.tracking import TrackingSettings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Flags of the subcommand."""
    add_paths(parser, "table to write (.csv)")
    add_fields(parser, VortexSettings)
    add_fields(parser, TrackingSettings)
    parser.add_argument(
        "--threads", type=int, default=1, help="processes that share the planes (default 1)"
    )


def make(
    source: str | Path,
    output: str | Path,
    settings: dict[str, Any],
    *,
    threads: int = 1,
    quiet: bool = False,
) -> None:
    """Write the table of the vortices in the vectors `source`.

    `settings`: the flags by name; ValueError for other keys. `threads` processes share the planes.
    """
    vortex, tracking = build(settings, VortexSettings, TrackingSettings)
    with open_vectors(source) as series:
        table = tabulate_vortices(series, vortex, tracking, processes=threads, quiet=quiet)
        length = units_of(series)[0]
    write_vortices(table, output, source=Path(source).name, **asdict(vortex), **asdict(tracking))
    if quiet:
        return
    tracks = table["track"].nunique()
    vortices = "vortex" if len(table) == 1 else "vortices"
    text = f"{output}: {len(table)} {vortices} in {tracks} track{'s' * (tracks != 1)}"
    if table["circulation"].notna().any():
        strongest = table.loc[table["circulation"].abs().idxmax()]
        unit, std = circulation_unit(length), strongest["circulation_std"]
        text += (
            f"; the strongest has a circulation of {strongest['circulation']:.3g}"
            f" ± {float(f'{std:.2g}'):g} {unit}"
        )
        radius = strongest["circulation_radius"]
        text += (
            " in all, by a Lamb-Oseen fit"
            if pd.isna(radius)
            else f" within {radius:.3g} {length} of its centre"
        )
    print(text)


run = partial(run_with, make)
