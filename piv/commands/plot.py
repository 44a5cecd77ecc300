"""Vectors over vorticity with vortex centres, as a picture."""

import argparse
import io

import numpy as np

from piv.fields.summary import summary
from piv.files.atomic import write_bytes
from piv.files.settings import add_paths, at_least, positive
from piv.foreign.read import open_vectors
from piv.formats.plane_series import checked, usable
from piv.formats.vortex_table import read_vortices
from piv.plots.vectors import Style, draw, shaded, unit_of, vortices_at


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `piv plot`."""
    add_paths(parser, ".png, .pdf or .svg")
    add_style(parser)
    parser.add_argument(
        "--time",
        type=float,
        help="instant, in the file's unit: s or frames (default: the highest mean speed)",
    )


def add_style(parser: argparse.ArgumentParser) -> None:
    """Options that pictures and animations share."""
    parser.add_argument("--vortices", help="vortices.csv, to mark centres and cores")
    parser.add_argument("--metres", action="store_true", help="axes in m instead of mm")
    parser.add_argument(
        "--vorticity-limit", type=positive, help="end of the colour scale, 1/s or 1/frame"
    )
    parser.add_argument("--arrow-every", type=at_least(1, int), help="draw each n-th vector")
    parser.add_argument(
        "--colour-by",
        default="vorticity",
        metavar="NAME",
        help="variable of the file (default vorticity)",
    )
    parser.add_argument("--streamlines", action="store_true", help="streamlines in place of arrows")


def style_of(args: argparse.Namespace, limit: float | None) -> Style:
    """The style that the options ask for, with the end of the colour scale."""
    return Style(not args.metres, limit, args.arrow_every, args.colour_by, args.streamlines)


def run(args: argparse.Namespace) -> None:
    """Draw one instant."""
    import matplotlib.pyplot as plt

    with checked(open_vectors(args.source), args.source) as planes:
        plane, time = planes, None
        if "time" in planes.dims:
            times, unit = planes["time"].values, planes["time"].attrs.get("units", "s")
            if args.time is None:
                speed = [
                    float(np.nanmean(np.abs(planes["u"][k].values)))
                    if usable(planes.isel(time=k)).any()
                    else 0.0
                    for k in range(times.size)
                ]
                index = int(np.argmax(speed))
            else:
                index = int(np.argmin(np.abs(times - args.time)))
                if not times[0] - 1e-9 <= args.time <= times[-1] + 1e-9:
                    raise ValueError(
                        f"{args.source}: --time {args.time} is outside {times[0]:g} to "
                        f"{times[-1]:g} {unit}"
                    )
            plane, time = planes.isel(time=index), float(times[index])
        style = style_of(args, args.vorticity_limit)
        table = read_vortices(args.vortices) if args.vortices else None
        figure = draw(plane, vortices_at(table, time), style=style)
        colours = shaded(plane, style.colour_by)
        coloured = f"{style.colour_by} {np.nanmin(colours):.3g} to {np.nanmax(colours):.3g} "
        coloured += unit_of(plane, style.colour_by)
        description = f"{coloured.rstrip()}; {summary(plane)}"
    content = io.BytesIO()
    figure.savefig(content, format=args.output.suffix[1:])
    plt.close(figure)
    write_bytes(args.output, content.getbuffer())
    if not args.quiet:
        print(f"{args.output}: {f'{time:g} {unit}, ' if time is not None else ''}{description}")
