"""Command line: piv COMMAND: vectors from images, and what follows from them."""

import argparse
import glob
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

from piv.files.atomic import check_output as check_regular
from piv.files.command import command_line
from piv.files.lock import exclusive

COMMANDS = {
    "correlate": "image pairs or a recording to a vector plane series",
    "join": "the chunks of a recording to one vector plane series",
    "render": "a plane series to a synthetic recording",
    "vortices": "a plane series to a table of vortices and their tracks",
    "calibrate": "scale, origin and lens distortion from points or a target",
    "mask": "masks from a polygon, moving outlines or a dark body",
    "plot": "vectors over vorticity with vortex centres, as a picture",
    "animate": "the same over time, as MP4 or GIF",
    "stats": "mean, RMS, Reynolds stresses over time, per phase or per bin",
    "derive": "vorticity, divergence, strain, swirling strength, Q",
    "pressure": "pressure of the water and its loads on outlines, from a series",
    "profile": "vectors along a line, as CSV",
    "spectrum": "power spectra in time or space, as CSV",
    "score": "vectors of any program against the exact truth of a recording",
    "view": "images and vectors in the browser: masks, measures, settings to try",
    "convert": "vectors of OpenPIV, PIVlab, DaVis, TSI and others; to CSV, MATLAB, VTK",
}

WRITTEN = {  # the endings of a command's output; the others look at theirs themselves
    "correlate": (".h5",),
    "join": (".h5",),
    "render": (".h5",),
    "vortices": (".csv",),
    "plot": (".png", ".pdf", ".svg"),
    "animate": (".mp4", ".gif"),
    "stats": (".h5",),
    "derive": (".h5",),
    "pressure": (".h5",),
    "profile": (".csv",),
    "spectrum": (".csv",),
    "score": (".csv",),
    "view": (".json",),
}


def check_output(output: Path, args: argparse.Namespace) -> None:
    """ValueError where the output would overwrite an input, also one in a folder or glob."""
    if not output.exists():
        return
    check_regular(output)
    values = [value for name, value in vars(args).items() if name != "output"]
    words = [v for value in values for v in (value if isinstance(value, list) else [value])]
    for source in (str(word) for word in words if isinstance(word, str | Path)):
        if Path(source).is_dir():  # of which images are read
            from piv.images.open_recording import IMAGE_SUFFIXES

            lost = output.suffix.lower() in IMAGE_SUFFIXES and output.parent.samefile(source)
        else:
            inputs = [Path(source), *map(Path, glob.glob(source))]
            lost = any(path.is_file() and output.samefile(path) for path in inputs)
        if lost:
            raise ValueError(
                f"{output}: is an input of this command and would be lost; give -o another name"
            )


@contextmanager
def _output_locked(args: argparse.Namespace) -> Iterator[None]:
    """Hold the lock on the command's output, which is none of its inputs."""
    output = getattr(args, "output", None)
    if output:
        check_output(Path(output), args)
        endings = WRITTEN.get(args.command, ())
        if endings and Path(output).suffix.lower() not in endings:
            raise ValueError(
                f"{output}: piv {args.command} writes {' or '.join(endings)}; name it so"
            )
    with exclusive(Path(output)) if output else nullcontext():
        yield


def main(argv: list[str] | None = None) -> int:
    """Run one subcommand; returns the exit code (0 good, 2 bad input, 130 interrupted)."""
    commands = {name: (about, f"piv.commands.{name}") for name, about in COMMANDS.items()}
    return command_line("piv", __doc__, commands, argv, around=_output_locked)


if __name__ == "__main__":
    sys.exit(main())
