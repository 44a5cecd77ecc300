"""python -m piv vortices piv.h5 -o vortices.csv: vortices of a plane series, and their tracks."""

from __future__ import annotations

import argparse
from dataclasses import asdict, fields
from pathlib import Path

from fileio.formats.plane_series import read_plane
from fileio.formats.vortex_table import write_vortices
from piv.commands.settings import add_fields, add_settings, build, existing, merged
from piv.vortices.find import VortexSettings
from piv.vortices.table import tabulate_vortices
from piv.vortices.tracking import TrackingSettings

HELPS = {
    "stencil_radius": "radius of the Gamma2 disc, in the plane's unit of length",
    "gamma2": "least |Gamma2| of a vortex region",
    "min_points": "least grid points of a region",
    "max_elongation": "longest region, length over width",
    "min_circulation": "least |circulation| in the plane's units",
    "min_part": "least |circulation| as a part of the plane's strongest, where --min-circulation is not given",
    "significance": "least |circulation| over its standard error",
    "fit_radius": "radius of the fitted disc, core radii",
    "min_explained": "least part of the variance that a fit must explain",
    "neighbour_part": "neighbours weaker than this part of a vortex belong to its background",
    "strain_prior": "expected background strain over the vortex' peak vorticity",
    "rotation_prior": "expected background vorticity over the vortex' peak vorticity",
    "region_prior": "expected scatter of a core radius about its region's, the disc half hidden",
    "correlation_length": "distance over which vector errors are correlated: the window's width",
    "weights": "of the vectors in the fit: uncertainty (where given) or equal",
    "scheme": "of the gradients: least-squares or fourth-order",
    "agility": "velocity change per frame, core radii",
    "scatter": "scatter of a position, core radii",
    "gate": "largest Mahalanobis distance of a step",
    "max_step": "largest step off the prediction, core radii",
    "circulation_change": "relative circulation change that weighs as one standard deviation",
    "max_missed": "frames without detection after which a track ends",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Flags of the subcommand."""
    parser.add_argument("plane_series", help="plane series or single plane (.h5), in m or px")
    parser.add_argument("-o", "--output", required=True, help="table to write (.csv)")
    add_fields(parser, VortexSettings, HELPS)
    add_fields(parser, TrackingSettings, HELPS)
    parser.add_argument("--threads", type=int, default=1, help="processes that share the planes (default 1)")
    add_settings(parser)


def run(args: argparse.Namespace) -> None:
    """Write the table."""
    known = {f.name for kind in (VortexSettings, TrackingSettings) for f in fields(kind)}
    given = merged(args, known)
    settings, tracking = build(VortexSettings, given), build(TrackingSettings, given)
    with read_plane(existing(args.plane_series)) as series:
        table = tabulate_vortices(series, settings, tracking, processes=args.threads, quiet=args.quiet)
    write_vortices(
        table, args.output, source=Path(args.plane_series).name, **asdict(settings), **asdict(tracking)
    )
    if not args.quiet:
        print(f"{args.output}: {len(table)} vortices in {table['track'].nunique()} tracks")
