"""The keys of dpiv.toml, and a file to start from, with what a folder of data shows by itself."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from fileio.hdf5 import open_hdf5
from fileio.key_reference import keys_of, template, toml_value
from piv.images.open_recording import (
    HDF5_SUFFIXES,
    IMAGE_SUFFIXES,
    PHOTRON_SUFFIXES,
    VIDEO_SUFFIXES,
    open_recording,
)
from postprocess.lab.data.dpiv_toml import VERSION, Dpiv

_FOUND = list(keys_of(Dpiv, without=frozenset({"folder"})))
_TABLES = [key.name.rpartition(".")[0] for key in _FOUND]
# the keys of one table stand together, where its first key is
KEYS = sorted(_FOUND, key=lambda key: _TABLES.index(key.name.rpartition(".")[0]))


def dpiv_template(data: Path | None) -> str:
    """A dpiv.toml to start from, with what the files of a folder show filled in."""
    return template(KEYS, seen_in(data) if data else None)


# one file is the recording
WHOLE = (*PHOTRON_SUFFIXES, *VIDEO_SUFFIXES, *HDF5_SUFFIXES)


def seen_in(folder: Path) -> dict[str, str]:
    """Values of dpiv.toml by dotted name; FileNotFoundError without pictures or vectors."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    kinds = Counter(path.suffix.lower() for path in files)
    suffix = next((s for s in WHOLE if kinds[s]), None)
    suffix = suffix or max(IMAGE_SUFFIXES, key=lambda s: kinds[s])
    if not kinds[suffix]:
        raise FileNotFoundError(
            f"{folder}: holds neither pictures nor vectors.h5; make that of other programs' vectors"
            " by piv convert FILES -o vectors.h5"
        )
    first = next(path for path in files if path.suffix.lower() == suffix)
    inside = first.relative_to(folder)
    pattern = inside if suffix in WHOLE else inside.with_name(f"*{first.suffix}")
    values: dict[str, object] = {
        "format": "dpiv",
        "format_version": VERSION,
        "title": folder.resolve().name,
        "files": pattern.as_posix(),
        "kind": "vectors" if suffix in HDF5_SUFFIXES and _holds_vectors(first) else "pictures",
    }
    if values["kind"] == "pictures":
        with open_recording(str(folder / pattern), colour="luma") as recording:
            if rate := recording.attrs.get("frame_rate_hz"):
                values["frame_rate_hz"] = float(rate)
    return {name: toml_value(value) for name, value in values.items()}


def _holds_vectors(path: Path) -> bool:
    """Whether an HDF5 file is a plane series (u and v), not a recording."""
    with open_hdf5(path) as file:
        return "u" in file and "v" in file
