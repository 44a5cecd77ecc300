"""Mean, RMS, Reynolds stresses and standard errors over time, per phase, or per bin."""

import argparse
from pathlib import Path

import numpy as np
import xarray as xr
from numpy import ndarray

from piv.fields.groups import at_instants, bins, phases, trigger_phases
from piv.fields.statistics import statistics
from piv.fields.summary import summary
from piv.files.settings import add_paths, at_least
from piv.foreign.read import open_vectors
from piv.formats.plane_series import absent, write_plane
from piv.formats.user_tables import read_columns

_PHASES = 16  # of an average over a period


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `piv stats`."""
    add_paths(parser, "plane (series) of the statistics, .h5")
    parser.add_argument(
        "--least", type=int, default=2, help="usable vectors that a mean needs (default 2)"
    )
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument(
        "--period", type=float, help="phase average: the period, in the series' unit of time"
    )
    kind.add_argument(
        "--triggers",
        nargs=2,
        metavar=("CSV", "COLUMN"),
        help="phase average: times of the triggers",
    )
    kind.add_argument(
        "--by",
        metavar="NAME",
        help="conditional average: a column of --table, or a variable of the series over time",
    )
    parser.add_argument("--start", type=float, help="time of phase 0 with --period (default 0)")
    parser.add_argument(
        "--phases", type=at_least(1, int), help=f"number of phases (default {_PHASES})"
    )
    parser.add_argument(
        "--table", type=Path, help="CSV with columns time and NAME, linear between its rows"
    )
    parser.add_argument(
        "--bins", type=float, nargs="+", metavar="EDGE", help="edges of the bins of --by, ascending"
    )


def run(args: argparse.Namespace) -> None:
    """Read the series once and write its statistics."""
    _check_partners(args)
    with open_vectors(args.source) as series:
        if "time" not in series["u"].dims:
            raise ValueError(f"{args.source}: a single plane; statistics over time need a series")
        number, centres, unit = _groups_of(args, series)
        there = ~absent(series)
        dataset = statistics(series, number, centres, centre_units=unit, least=args.least)
    write_plane(dataset, args.output)
    if not args.quiet:
        print(f"{args.output}: {summary(dataset)}")
        print(
            _words_on(
                dataset,
                int((there if number is None else there & (number >= 0)).sum()),
                series.sizes["time"],
            )
        )


def _check_partners(args: argparse.Namespace) -> None:
    """ValueError where an option lacks the one that it belongs to."""
    if args.by is None and (args.bins is not None or args.table is not None):
        raise ValueError("--bins and --table go with --by")
    if args.period is None and args.start is not None:
        raise ValueError("--start goes with --period")
    if args.period is None and args.triggers is None and args.phases is not None:
        raise ValueError("--phases goes with --period or --triggers")


def _groups_of(
    args: argparse.Namespace, series: xr.Dataset
) -> tuple[ndarray | None, ndarray | None, str]:
    """Group of each instant, the groups' centres and their unit."""
    times = series["time"].values
    if args.by is not None:
        if args.bins is None:
            raise ValueError("--by needs --bins, the edges of the bins")
        return *bins(quantity(args, series), args.bins), "1"
    if args.period is not None:
        turned = phases(times, args.period, args.start or 0.0)
        between, whole = float(np.min(np.diff(times), initial=np.inf)), float(np.ptp(times))
        if not 2 * between <= args.period <= whole + between:
            unit = series["time"].attrs.get("units", "s")
            raise ValueError(
                f"{args.source}: --period {args.period:g} makes no phases: its instants are "
                f"{between:g} {unit} apart, "
                f"over {whole:g} {unit}; give a period from twice the one to the other"
            )
    elif args.triggers is not None:
        path, column = args.triggers
        turned = trigger_phases(
            times, read_columns(Path(path), [column], None).numbers([column]).ravel()
        )
    else:
        return None, None, ""
    number = _PHASES if args.phases is None else args.phases
    return *bins(turned, np.arange(number + 1) / number), "cycle"


def quantity(args: argparse.Namespace, series: xr.Dataset) -> ndarray:
    """Return the quantity that --by names, at each instant."""
    if args.table is not None:
        names = ["time", args.by]
        time, values = read_columns(args.table, names, None).numbers(names).T
        return at_instants(series["time"].values, time, values)
    if args.by not in series or series[args.by].dims[:1] != ("time",):
        raise ValueError(
            f"{args.source}: no variable {args.by!r} over time in it; give --table with a column "
            "of that name"
        )
    values = series[args.by].values
    if values.ndim > 1 and np.prod(values.shape[1:]) != 1:
        raise ValueError(
            f"{args.source}: {args.by!r} has several values at an instant; give --table"
        )
    return values.reshape(len(values))


def _words_on(dataset: xr.Dataset, used: int, count: int) -> str:
    """How many instants were used, and what they are worth."""
    worth = max(max(dataset.attrs["inefficiency_u"]), max(dataset.attrs["inefficiency_v"]))
    lowest, highest = int(dataset["n"].min()), int(dataset["n"].max())
    text = f"means over {used} of {count} instants, {lowest} to {highest} usable vectors at a point"
    if worth == 1.0:
        return f"{text}; standard errors take successive instants as independent"
    return f"{text}; in standard errors {worth:.3g} successive instants count as one"
