"""piv correlate A.tif B.tif -o out.h5: images or a recording to a plane series of vectors."""

import argparse
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from piv.commands.settings import add_fields, build, report, run_with
from piv.correlation.options import Options
from piv.formats.recording import CAMERA
from piv.images.clock import INTERVAL_HELP, RATE_HELP, set_clock
from piv.images.image_files import COLOURS
from piv.images.open_recording import open_recording
from piv.images.part_of_recording import part_of_recording
from piv.sequence.frame_sets import SequenceOptions
from piv.sequence.sequence import correlate_recording

# flags that no dataclass has
_FURTHER = ("chunk", "mask", "roi", "roi_unit", "colour")


@dataclass(frozen=True)
class _RecordingCamera:
    """Scale, origin and clock that replace those of the recording."""

    scale_mm_per_px: Annotated[
        float | None, "mm per pixel (default the recording's, else results in px)"
    ] = None
    origin_x_px: Annotated[
        float | None, "x of the origin, px from the left (default the recording's, else 0)"
    ] = None
    origin_y_px: Annotated[
        float | None, "y of the origin, px up from the bottom (default the recording's, else 0)"
    ] = None
    interval: Annotated[float | None, f"{INTERVAL_HELP} (default the recording's)"] = None
    rate: Annotated[
        float | None, f"{RATE_HELP} (default the recording's, else times in frames)"
    ] = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            origin = name.startswith("origin")
            if value is not None and not (np.isfinite(value) and (origin or value > 0)):
                raise ValueError(
                    f"{name} = {value:g}: give a {'finite' if origin else 'positive'} number"
                )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Flags of the subcommand."""
    parser.add_argument(
        "source",
        nargs="+",
        help="two or more images, a folder, a glob, a video, .mraw/.cihx or images.h5",
    )
    parser.add_argument("-o", "--output", required=True, help="plane series to write (.h5)")
    parser.add_argument(
        "--mask",
        metavar="FILE",
        help="polygon (.csv, px), image (not black = body), folder or pattern of one image per "
        "frame, "
        "or moving polygons (.json, .toml)",
    )
    parser.add_argument(
        "--roi",
        type=float,
        nargs=4,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="only this region, y up",
    )
    parser.add_argument(
        "--roi-unit", choices=("px", "m"), default="px", help="of --roi (default px)"
    )
    add_fields(parser, Options)
    add_fields(parser, SequenceOptions)
    parser.add_argument(
        "--chunk",
        metavar="K/N",
        help="only the K-th of N parts, into a file beside the output; then: piv join OUTPUT",
    )
    add_fields(parser, _RecordingCamera)
    parser.add_argument(
        "--colour",
        choices=COLOURS,
        default=argparse.SUPPRESS,
        help="how to make coloured images grey (default refuse)",
    )


def make(
    source: str | Path | list[str],
    output: str | Path,
    settings: dict[str, Any],
    *,
    threads: int = 1,
    quiet: bool = False,
) -> None:
    """Correlate the recording `source` into the plane series `output`.

    `settings`: the flags by name; ValueError for other keys. `threads` fields are computed at a
    time.
    """
    options, sequence, camera = build(
        {"threads": threads} | settings, Options, SequenceOptions, _RecordingCamera, more=_FURTHER
    )
    chunk = _chunk(settings["chunk"]) if settings.get("chunk") else None
    sources = [source] if isinstance(source, str | Path) else source
    with open_recording(sources, colour=settings.get("colour", "refuse")) as recording:
        if len(recording) < 2:
            raise ValueError(
                f"{recording.name}: one frame is no pair; give two images or a recording"
            )
        if recording.lossy and (chunk is None or chunk[0] == 1):
            print(
                f"{recording.name}: JPEG loses detail of the particles; "
                "save TIFF or PNG where you can",
                file=sys.stderr,
                flush=True,
            )
        sequence = sequence.of(recording)
        assert sequence.pairing is not None
        set_clock(recording, sequence.pairing, camera.interval, camera.rate, sequence.skip)
        if (
            camera.scale_mm_per_px is not None
            and recording.times is None
            and recording.interval is None
        ):
            raise ValueError(
                f"{recording.name}: --scale-mm-per-px gives m/s with the time between the "
                "exposures; give --interval too"
            )
        recording.attrs |= {
            k: float(v) for k, v in vars(camera).items() if v is not None and k in CAMERA
        }
        part = part_of_recording(
            recording,
            settings.get("mask"),
            settings.get("roi"),
            roi_unit=settings.get("roi_unit", "px"),
        )
        path = correlate_recording(part, output, options, sequence, chunk=chunk, quiet=quiet)
    if not quiet:
        report(path)


def _chunk(text: str) -> tuple[int, int]:
    """(k, n) of "k/n"."""
    number, _, of = text.partition("/")
    if not (number.isdecimal() and of.isdecimal()):
        raise ValueError(f"chunk must be k/n, such as 2/8, got {text!r}")
    return int(number), int(of)


run = partial(run_with, make)
