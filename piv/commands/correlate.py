"""piv correlate A.tif B.tif -o out.h5: images, or a whole recording, to a plane series of vectors."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import xarray as xr

from fileio.formats.plane_series import FINGER_VARIABLES
from fileio.hdf5 import open_netcdf
from piv.commands.settings import add_fields, build, report, run_with
from piv.correlation.options import Options
from piv.images.image_files import COLOURS
from piv.images.open_recording import open_recording
from piv.images.part_of_recording import part_of_recording
from piv.sequence.chunks import chunk_path, parse
from piv.sequence.ensemble import correlate_ensemble_to
from piv.sequence.sequence import SequenceOptions, correlate_recording

# flags that no dataclass has
FURTHER = ("ensemble", "chunk", "mask", "roi", "roi_unit", "colour")


@dataclass(frozen=True)
class RecordingCamera:
    """Scale, origin and frame rate that replace those of the recording."""

    scale_mm_per_px: Annotated[
        float | None, "mm per pixel (default the recording's, else results in px)"
    ] = None
    origin_x_px: Annotated[
        float | None, "x of the origin, px from the left (default the recording's, else 0)"
    ] = None
    origin_y_px: Annotated[
        float | None, "y of the origin, px up from the bottom (default the recording's, else 0)"
    ] = None
    frame_rate_hz: Annotated[
        float | None, "frames per second (default the recording's, else times in frames)"
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
        help="polygon (.csv, px), image (not black = body), folder or pattern of one image per frame, "
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
        "--ensemble",
        action=argparse.BooleanOptionalAction,
        default=argparse.SUPPRESS,
        help="one mean field from the summed correlations of all pairs (default no)",
    )
    parser.add_argument(
        "--chunk",
        metavar="K/N",
        help="only the K-th of N parts, into a file beside the output; then: piv join OUTPUT",
    )
    add_fields(parser, RecordingCamera)
    parser.add_argument(
        "--colour",
        choices=COLOURS,
        default=argparse.SUPPRESS,
        help="how to make coloured images grey (default refuse)",
    )
    parser.add_argument("--quiet", action="store_true", help="no progress bar")


def make(
    source: str | Path | list[str],
    output: str | Path,
    settings: dict[str, Any],
    *,
    threads: int = 1,
    quiet: bool = False,
) -> None:
    """Correlate the recording `source` into the plane series `output`.

    `settings`: the flags by name; ValueError for other keys. `threads` fields are computed at a time.
    """
    options, sequence, camera = build(
        {"threads": threads} | settings, Options, SequenceOptions, RecordingCamera, more=FURTHER
    )
    chunk = parse(settings["chunk"]) if settings.get("chunk") else None
    if chunk and settings.get("ensemble"):
        raise ValueError("an ensemble is one field of all pairs; leave out --chunk or --ensemble")
    sources = [source] if isinstance(source, str | Path) else source
    with open_recording(
        sources, frame_rate_hz=camera.frame_rate_hz, colour=settings.get("colour", "refuse")
    ) as recording:
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
        for name in ("origin_x_px", "origin_y_px"):
            if (value := getattr(camera, name)) is not None:
                recording.attrs[name] = float(value)
        if camera.scale_mm_per_px is not None:
            if recording.times is None:
                raise ValueError(
                    f"{recording.name}: scale_mm_per_px gives m/s with the times of its frames; "
                    "give frame_rate_hz too"
                )
            recording.attrs["scale_m_per_px"] = camera.scale_mm_per_px * 1e-3
        part = part_of_recording(
            recording,
            settings.get("mask"),
            settings.get("roi"),
            roi_unit=settings.get("roi_unit", "px"),
        )
        if settings.get("ensemble"):
            path = correlate_ensemble_to(part, output, options, sequence, quiet=quiet)
        else:
            finger = finger_of(sources)
            path = correlate_recording(
                part,
                chunk_path(output, *chunk) if chunk else output,
                options,
                sequence,
                finger=finger,
                chunk=chunk,
                quiet=quiet,
            )
            if finger is not None:
                finger.close()
    if not quiet:
        report(path)


def finger_of(sources: list[Any]) -> xr.Dataset | None:
    """The finger's variables of a recording file, lazily, or None where there are none."""
    if len(sources) != 1 or Path(sources[0]).suffix.lower() not in (".h5", ".hdf5"):
        return None
    dataset = open_netcdf(sources[0], decode_times=False)
    if not any(name in dataset for name in FINGER_VARIABLES):
        dataset.close()
        return None
    return dataset


run = partial(run_with, make)
