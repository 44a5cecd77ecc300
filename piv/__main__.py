"""Command line: python -m piv correlate|join|render|vortices|calibrate|mask|plot|animate|convert."""

from __future__ import annotations

import argparse
import glob
import importlib
import sys
from contextlib import nullcontext
from pathlib import Path

from fileio.errors import sentence
from fileio.lock import exclusive

COMMANDS = {
    "correlate": "image pairs or a recording to a vector plane series",
    "join": "the chunks of a recording to one vector plane series",
    "render": "a plane series to a synthetic recording",
    "vortices": "a plane series to a table of vortices and their tracks",
    "calibrate": "scale, origin and lens distortion from points or a target",
    "mask": "masks from a polygon, an image or a dark body",
    "plot": "vectors over vorticity with vortex centres, as a picture",
    "animate": "the same over time, as MP4 or GIF",
    "convert": "between OpenPIV, PIVlab, Tecplot, DaVis, CSV, VTK and plane series",
}


def check_output(output: Path, args: argparse.Namespace) -> None:
    """ValueError where the output would be written over one of the command's inputs, those of a folder or glob included."""
    if not output.is_file():
        return
    given = [v for name, value in vars(args).items() if name != "output" for v in
             (value if isinstance(value, list | tuple) else [value]) if isinstance(v, str | Path)]  # fmt: skip
    for source in map(str, given):
        if Path(source).is_dir():  # of which images are read
            from piv.images.open_recording import IMAGE_SUFFIXES

            lost = output.suffix.lower() in IMAGE_SUFFIXES and output.parent.samefile(source)
        else:
            found = [Path(source), *map(Path, glob.glob(source))]
            lost = any(path.is_file() and output.samefile(path) for path in found)
        if lost:
            raise ValueError(f"{output}: is an input of this command and would be lost; give -o another name")


def main(argv: list[str] | None = None) -> int:
    """Run one subcommand; returns the exit code (0 good, 2 bad input, 130 interrupted)."""
    parser = argparse.ArgumentParser(prog="python -m piv", description=__doc__)
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="command")
    arguments = sys.argv[1:] if argv is None else argv
    wanted = arguments[0] if arguments and arguments[0] in COMMANDS else None
    for name, help_line in COMMANDS.items():
        sub = subparsers.add_parser(name, help=help_line, description=help_line)
        if name == wanted:  # import only what runs: the others' libraries are slow to load
            importlib.import_module(f"piv.commands.{name}").add_arguments(sub)
    args = parser.parse_args(arguments)
    output = getattr(args, "output", None)
    try:
        if output:
            check_output(Path(output), args)
        with exclusive(Path(output)) if output else nullcontext():
            importlib.import_module(f"piv.commands.{args.command}").run(args)
    except Exception as error:
        message = sentence(error)
        if message is None:
            raise
        print(f"piv {args.command}: {message}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"piv {args.command}: interrupted; finished frames are kept", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
