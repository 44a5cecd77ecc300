"""A recording in parts: joined, the file equals that of one job to the last byte."""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from piv.files.hdf5 import open_hdf5
from piv.files.json_text import parse_json
from piv.formats.plane_series import FINGER_VARIABLES
from piv.formats.resumable import FIELDS, SeriesWriter

BLOCK = 1000  # fields' finger variables in memory at a time


@dataclass(frozen=True)
class Chunk:
    """The `number`-th of `of` parts of a series of `fields`: `count` fields from `first` on."""

    number: int
    of: int
    first: int
    count: int
    fields: int

    @classmethod
    def of_series(cls, fields: int, number: int, of: int) -> "Chunk":
        """Parts differ by one field at most. ValueError where there is no such part."""
        if not 1 <= number <= of:
            raise ValueError(f"chunk {number}/{of}: give k/n with k from 1 to n")
        if of > fields:
            raise ValueError(
                f"chunk {number}/{of}: the recording gives only {fields} fields; ask for fewer "
                "chunks"
            )
        first, last = (fields * k // of for k in (number - 1, number))
        return cls(number, of, first, last - first, fields)


def series_key(identity: Any) -> str:
    """Short for what the fields of a series depend on; equal of the whole and of its parts."""
    return hashlib.sha256(json.dumps(identity, default=str).encode()).hexdigest()


def chunk_path(output: str | Path, number: int, of: int) -> Path:
    """Where part `number` of the series `output` lies: beside it."""
    path = Path(output)
    return path.with_name(f"{path.stem}.chunk-{number:04d}-of-{of:04d}{path.suffix}")


def is_chunk(path: str | Path, attribute: str) -> bool:
    """Whether `path` is the finished part of this recording and these settings (`attribute`)."""
    try:
        with h5py.File(path, "r") as file:
            return bool(file.attrs.get("chunk") == attribute)
    except OSError:
        return False


def parts_of(output: str | Path) -> list[Path]:
    """The parts beside `output`, in order; ValueError where the set is incomplete or mixed."""
    path = Path(output)
    parts = sorted(path.parent.glob(f"{path.stem}.chunk-*-of-*{path.suffix}"))
    divisions = {p.name.rpartition("-of-")[2] for p in parts}
    if len(divisions) != 1:
        if not parts:
            raise ValueError(
                f"{path}: there are no {path.stem}.chunk-*-of-*{path.suffix} beside it; "
                "make each with the same piv correlate and --chunk 1/N, 2/N …"
            )
        kinds = ", ".join(f"of-{d.removesuffix(path.suffix)}" for d in sorted(divisions))
        raise ValueError(
            f"{path}: beside it are chunks of several divisions ({kinds}); remove all but one of "
            "them"
        )
    of = int(divisions.pop().removesuffix(path.suffix))
    missing = [k for k in range(1, of + 1) if not chunk_path(path, k, of).exists()]
    if missing:
        raise ValueError(
            f"{chunk_path(path, missing[0], of)}: missing, with {len(missing)} of {of} chunks; "
            f"{_made_by(missing[0], of)}"
        )
    return parts


def _made_by(number: int, of: int) -> str:
    """What a person does to get a part that is missing or cannot be used."""
    return f"make it with the same piv correlate and --chunk {number}/{of}"


def join(parts: list[Path], output: str | Path) -> Path:
    """Join the parts into the plane series `output`; ValueError where they are not of one whole."""
    first = 0
    heads: list[dict[str, Any]] = []
    times = []
    for number, path in enumerate(parts, 1):
        again = f"remove it and {_made_by(number, len(parts))}"
        with open_hdf5(path) as file:
            if "chunk" not in file.attrs:
                raise ValueError(
                    f"{path}: not a chunk of a series (attribute 'chunk' is missing); {again}"
                )
            head = parse_json(file.attrs["chunk"], path, again)
            times.append(file["time"][...])
        if heads and head["identity"] != heads[0]["identity"]:
            raise ValueError(
                f"{path}: of another recording or other settings than {parts[0]}; {again}"
            )
        if head["first"] != first or len(times[-1]) != head["count"]:
            raise ValueError(
                f"{path}: begins with field {head['first']}, expected {first}; {again}"
            )
        heads.append(head)
        first += head["count"]
    if not heads or first != heads[0]["fields"]:
        raise ValueError(
            f"{output}: the parts hold {first} of {heads[0]['fields'] if heads else 0} fields"
        )
    with h5py.File(parts[0], "r") as file:
        attrs = {
            n: v for n, v in file.attrs.items() if n not in ("chunk", "format", "format_version")
        }
        units = {name: file[name].attrs["units"] for name in ("x", "y", "time", "u")}
        axes = file["x"][...], file["y"][...]
        fingers = {name: _dims(file[name]) for name in FINGER_VARIABLES if name in file}
        shapes = {name: file[name].shape[1:] for name in fingers}
    identity = [heads[0]["identity"], heads[0]["stamp"]]  # as of the whole in one job
    writer = SeriesWriter(output, *axes, np.concatenate(times), units, attrs, identity)
    try:
        for path, head in zip(parts, heads, strict=True):
            with h5py.File(path, "r") as file:
                for k in range(head["count"]):
                    if head["first"] + k not in writer.done:
                        writer.write(head["first"] + k, {name: file[name][k] for name in FIELDS})
        for name, dims in fingers.items():
            writer.add(name, dims, (first, *shapes[name]), _blocks(parts, name))
        return writer.finish()
    finally:
        writer.close()


def _dims(variable: h5py.Dataset) -> tuple[str, ...]:
    return tuple(dim[0].name.rpartition("/")[2] for dim in variable.dims)


def _blocks(parts: list[Path], name: str) -> Iterator[np.ndarray]:
    for path in parts:
        with h5py.File(path, "r") as file:
            variable = file[name]
            for begin in range(0, len(variable), BLOCK):
                yield variable[begin : begin + BLOCK]
