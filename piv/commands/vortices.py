"""piv vortices piv.h5 -o vortices.csv: vortices of a plane series, and their tracks."""

from __future__ import annotations

import argparse
from dataclasses import asdict, fields
from pathlib import Path

from fileio.formats.vortex_table import write_vortices
from piv.commands.settings import add_fields, add_settings, build, existing, merged
from piv.foreign.read import open_vectors
from piv.foreign.write import units_of
from piv.vortices.find import VortexSettings
from piv.vortices.table import tabulate_vortices
from piv.vortices.tracking import TrackingSettings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Flags of the subcommand."""
    parser.add_argument(
        "plane_series", help="vectors, in m or px: .h5, .nc or another file of piv convert"
    )
    parser.add_argument("-o", "--output", required=True, help="table to write (.csv)")
    add_fields(parser, VortexSettings)
    add_fields(parser, TrackingSettings)
    parser.add_argument(
        "--threads", type=int, default=1, help="processes that share the planes (default 1)"
    )
    add_settings(parser)


def run(args: argparse.Namespace) -> None:
    """Write the table."""
    known = {f.name for kind in (VortexSettings, TrackingSettings) for f in fields(kind)}
    given = merged(args, known)
    settings, tracking = build(VortexSettings, given), build(TrackingSettings, given)
    with open_vectors(existing(args.plane_series)) as series:
        table = tabulate_vortices(
            series, settings, tracking, processes=args.threads, quiet=args.quiet
        )
        length = units_of(series)[0]
    write_vortices(
        table,
        args.output,
        source=Path(args.plane_series).name,
        **asdict(settings),
        **asdict(tracking),
    )
    if not args.quiet:
        tracks = table["track"].nunique()
        vortices = "vortex" if len(table) == 1 else "vortices"
        text = f"{args.output}: {len(table)} {vortices} in {tracks} track{'s' * (tracks != 1)}"
        if len(table):
            strongest = table.loc[table["circulation"].abs().idxmax()]
            unit = "px²/frame" if length == "px" else f"{length}²/s"
            text += (
                f"; the strongest has a circulation of {strongest['circulation']:.3g} {unit} "
                f"and a core radius of {strongest['core_radius']:.3g} {length}"
            )
        print(text)
