"""Vectors over vorticity over time, as MP4, WebM or GIF."""

import argparse
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from tqdm import tqdm

from piv.commands.plot import add_style, style_of
from piv.fields.summary import summary
from piv.files.atomic import write_bytes
from piv.files.settings import add_paths, at_least, positive
from piv.foreign.read import open_vectors
from piv.formats.plane_series import checked
from piv.formats.vortex_table import read_vortices
from piv.plots.film import write_film


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `piv animate`."""
    add_paths(parser, ".mp4, .webm or .gif")
    parser.add_argument("--fps", type=positive, default=20, help="pictures per second (default 20)")
    parser.add_argument("--every", type=at_least(1, int), default=1, help="use each n-th instant")
    add_style(parser)


def run(args: argparse.Namespace) -> None:
    """Draw all instants with one scale of colour and arrows, and join them."""
    import matplotlib.pyplot as plt

    from piv.plots.vectors import draw, speed_scale, vortices_at, vorticity_scale

    with checked(open_vectors(args.source), args.source) as planes:
        if "time" not in planes.dims:
            raise ValueError(f"{args.source}: a single instant; use 'piv plot'")
        chosen = range(0, planes.sizes["time"], args.every)
        some = planes.isel(time=np.unique(np.linspace(0, planes.sizes["time"] - 1, 20).astype(int)))
        speed = speed_scale(some)
        style = style_of(args, args.vorticity_limit or vorticity_scale(some, args.colour_by))
        table = read_vortices(args.vortices) if args.vortices else None

        def pictures() -> Iterator[np.ndarray]:
            for k in tqdm(chosen, desc="pictures", disable=args.quiet or None):
                plane = planes.isel(time=k)
                figure = draw(
                    plane, vortices_at(table, float(plane["time"])), style=style, speed=speed
                )
                figure.set_dpi(130)
                figure.canvas.draw()
                rgba = figure.canvas.buffer_rgba()  # type: ignore[attr-defined]
                picture = np.asarray(rgba)[..., :3]
                plt.close(figure)
                rows, columns = (
                    picture.shape[0] // 2 * 2,
                    picture.shape[1] // 2 * 2,
                )  # H.264 wants even sizes
                yield np.ascontiguousarray(picture[:rows, :columns])

        if args.output.suffix.lower() == ".gif":
            _write_gif(args.output, pictures(), args.fps)
        else:
            write_film(pictures(), args.output, args.fps)
        if not args.quiet:
            print(f"{args.output}: {len(chosen)} pictures; {summary(planes)}")


def _write_gif(path: Path, pictures: Iterator[np.ndarray], fps: float) -> None:
    from PIL import Image

    first = Image.fromarray(next(pictures)).quantize(128)
    rest = (Image.fromarray(p).quantize(128) for p in pictures)
    content = io.BytesIO()
    first.save(
        content, "GIF", save_all=True, append_images=rest, duration=round(1000 / fps), loop=0
    )
    write_bytes(path, content.getbuffer())
