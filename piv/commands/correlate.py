"""piv correlate A.tif B.tif -o out.h5: images, or a whole recording, to a plane series of vectors."""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import as_completed
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import numpy as np
import xarray as xr
from tqdm import tqdm

from fileio.child_process import worker_pool
from fileio.formats.plane_series import FINGER_VARIABLES
from fileio.hdf5 import open_netcdf
from piv.commands.settings import add_fields, add_settings, build, merged, report
from piv.correlation.options import Options
from piv.images.image_files import COLOURS
from piv.images.open_recording import open_recording
from piv.images.part_of_recording import part_of_recording
from piv.sequence.chunks import chunk_path, join, parse, parts_of
from piv.sequence.ensemble import correlate_ensemble_to
from piv.sequence.sequence import SequenceOptions, correlate_recording

CHUNKS_PER_PROCESS = 4  # so that no process waits long for the last


@dataclass(frozen=True)
class RecordingCamera:
    """What is given in place of what the recording says."""

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
    parser.add_argument(
        "--processes",
        type=int,
        default=1,
        help="share the recording out over so many processes, and join their parts (default 1)",
    )
    add_fields(parser, RecordingCamera)
    parser.add_argument(
        "--colour",
        choices=COLOURS,
        default=argparse.SUPPRESS,
        help="how to make coloured images grey (default refuse)",
    )
    add_settings(parser)


def run(args: argparse.Namespace) -> None:
    """Correlate and write."""
    known = {f.name for kind in (Options, SequenceOptions, RecordingCamera) for f in fields(kind)}
    given = merged(args, known | {"ensemble", "colour"})
    build(RecordingCamera, given)
    chunk = parse(args.chunk) if args.chunk else None
    if args.processes < 1:
        raise ValueError(f"processes must be at least 1, got {args.processes}")
    if (chunk or args.processes > 1) and given.get("ensemble"):
        raise ValueError(
            "an ensemble is one field of all pairs: it cannot be made in chunks or by processes"
        )
    if chunk and args.processes > 1:
        raise ValueError("give either --chunk or --processes")
    if args.processes > 1:
        share_out(args)
        path = Path(args.output)
    else:
        path = correlate(args, given, chunk)
    if not args.quiet:
        report(path)


def share_out(args: argparse.Namespace) -> None:
    """The chunks of a recording by several processes, joined; finished fields survive an interruption."""
    of = args.processes * CHUNKS_PER_PROCESS
    alone = argparse.Namespace(**vars(args) | {"processes": 1, "quiet": True})
    jobs = [argparse.Namespace(**vars(alone) | {"chunk": f"{k}/{of}"}) for k in range(1, of + 1)]
    with worker_pool(args.processes) as pool:
        waiting = [pool.submit(run, job) for job in jobs]
        try:
            for future in tqdm(
                as_completed(waiting),
                "correlate",
                len(jobs),
                unit="chunk",
                disable=args.quiet or None,
            ):
                future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    parts = parts_of(args.output)
    join(parts, args.output)
    for part in parts:
        part.unlink()


def correlate(args: argparse.Namespace, given: dict, chunk: tuple[int, int] | None) -> Path:
    """The whole recording, or one chunk of it."""
    options, sequence = build(Options, given), build(SequenceOptions, given)
    source = args.source[0] if len(args.source) == 1 else args.source
    with open_recording(
        source, frame_rate_hz=given.get("frame_rate_hz"), colour=given.get("colour", "refuse")
    ) as recording:
        if len(recording) < 2:
            raise ValueError(
                f"{recording.name}: one frame is no pair; give two images or a recording"
            )
        if recording.lossy and (chunk is None or chunk[0] == 1):
            print(
                f"{recording.name}: JPEG loses detail of the particles; save TIFF or PNG where you can",
                file=sys.stderr,
                flush=True,
            )
        recording.attrs |= {
            name: float(given[name]) for name in ("origin_x_px", "origin_y_px") if name in given
        }
        if "scale_mm_per_px" in given:
            if recording.times is None:
                raise ValueError(
                    f"{recording.name}: scale_mm_per_px gives m/s with the times of its frames; give frame_rate_hz too"
                )
            recording.attrs["scale_m_per_px"] = float(given["scale_mm_per_px"]) * 1e-3
        part = part_of_recording(recording, args.mask, args.roi, roi_unit=args.roi_unit)
        if given.get("ensemble"):
            return correlate_ensemble_to(part, args.output, options, sequence, quiet=args.quiet)
        output = chunk_path(args.output, *chunk) if chunk else args.output
        finger = finger_of(args.source)
        path = correlate_recording(
            part, output, options, sequence, finger=finger, chunk=chunk, quiet=args.quiet
        )
        if finger is not None:
            finger.close()
        return path


def finger_of(sources: list[str]) -> xr.Dataset | None:
    """The finger's variables of a recording file, lazily, or None where there are none."""
    if len(sources) != 1 or Path(sources[0]).suffix.lower() not in (".h5", ".hdf5"):
        return None
    dataset = open_netcdf(sources[0], decode_times=False)
    if not any(name in dataset for name in FINGER_VARIABLES):
        dataset.close()
        return None
    return dataset
