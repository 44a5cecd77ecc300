"""What a folder of pictures or vectors shows by itself of its dpiv.toml."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from fileio.hdf5 import open_hdf5
from fileio.key_reference import toml_value
from piv.images.masks import dark_body
from piv.images.open_recording import (
    HDF5_SUFFIXES,
    IMAGE_SUFFIXES,
    PHOTRON_SUFFIXES,
    VIDEO_SUFFIXES,
    open_recording,
)
from piv.images.recording import Recording
from postprocess.lab.data.dpiv_toml import VERSION

VECTOR_SUFFIXES = (".dat", ".vc7", ".mat", ".txt", ".csv")
WHOLE = (*PHOTRON_SUFFIXES, *VIDEO_SUFFIXES, *HDF5_SUFFIXES)  # one file is the recording
ROOT_ROWS = 8  # of the body from its upper end on, whose middle is taken for the root's


def seen_in(folder: Path) -> dict[str, str]:
    """Values of dpiv.toml by dotted name; FileNotFoundError without pictures or vectors."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    kinds = Counter(path.suffix.lower() for path in files)
    suffix = next((s for s in WHOLE if kinds[s]), None)
    suffix = suffix or max((*IMAGE_SUFFIXES, *VECTOR_SUFFIXES), key=lambda s: kinds[s])
    if not kinds[suffix]:
        raise FileNotFoundError(f"{folder}: holds neither pictures nor vectors of a known kind")
    first = next(path for path in files if path.suffix.lower() == suffix)
    inside = first.relative_to(folder)
    pattern = inside if suffix in WHOLE else inside.with_name(f"*{first.suffix}")
    values = {
        "format": "dpiv",
        "format_version": VERSION,
        "title": folder.resolve().name,
        "files": pattern.as_posix(),
    }
    exported = suffix in HDF5_SUFFIXES and _holds_vectors(first)
    values["kind"] = "vectors" if suffix in VECTOR_SUFFIXES or exported else "pictures"
    if values["kind"] == "pictures":
        with _opened(str(folder / pattern), values) as recording:
            values |= _seen_in_pictures(recording)
    return {name: toml_value(value) for name, value in values.items()}


def _holds_vectors(path: Path) -> bool:
    """Whether an HDF5 file is a plane series (u and v), not a recording."""
    with open_hdf5(path) as file:
        return "u" in file and "v" in file


def _opened(source: str, values: dict[str, object]) -> Recording:
    """The recording; coloured pictures are taken by their brightness, which `values` then says."""
    try:
        recording = open_recording(source)
        recording.frame(0)
    except ValueError as error:
        if "colour" not in str(error):
            raise
        values["colour"] = "luma"
        recording = open_recording(source, colour="luma")
    return recording


def _seen_in_pictures(recording: Recording) -> dict[str, object]:
    """Frame rate, where it is stated, and the finger's root, where a dark body is seen."""
    values: dict[str, object] = {}
    if rate := recording.attrs.get("frame_rate_hz"):
        values["frame_rate_hz"] = float(rate)
    try:
        row, column = np.nonzero(dark_body(recording.frame(0), grow_px=0))
    except ValueError:
        return values
    x = float(column[row < row.min() + ROOT_ROWS].mean())
    y = float(recording.shape[0] - 1 - row.min())
    return values | {"axes.y": "up", "axes.root_px": [round(x, 1), round(y, 1)]}
