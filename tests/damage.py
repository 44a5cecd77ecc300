"""Twelve ways in which a file is damaged: by a disk, by a kill, by another program, by hand."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np


def _flipped(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


def _zeroed(content: bytes) -> bytes:
    begin, size = len(content) // 3, max(1, len(content) // 10)
    return content[:begin] + bytes(size) + content[begin + size :]


BYTES: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda content: b"",
    "cut in half": lambda content: content[: len(content) // 2],
    "its first line or 20 bytes": lambda c: c[: min(20, c.find(b"\n") % 2**31 + 1)],
    "last byte missing": lambda content: content[:-1],
    "a bit flipped": _flipped,
    "a block of zeros": _zeroed,
    "noise": lambda content: np.random.default_rng(1).bytes(len(content)),
    "another format": lambda content: b"no such thing\n" * 9,
}
CONTENT = ("version 99", "a part taken out", "NaN", "1e30")
WAYS = (*BYTES, *CONTENT)


def damage(path: Path, way: str) -> None:
    """Damage a file in one of WAYS."""
    if way in BYTES:
        path.write_bytes(BYTES[way](path.read_bytes()))
    elif path.suffix == ".h5":
        with h5py.File(path, "r+") as file:
            _in_hdf5(file, way)
    elif path.suffix == ".json":
        content = json.loads(path.read_text())
        path.write_text(json.dumps(_in_json(content, way)))
    elif path.suffix == ".csv":
        path.write_text(_in_text(path.read_text(), way))
    else:
        path.write_bytes(_in_values(path.read_bytes(), way))


def _in_hdf5(file: h5py.File, way: str) -> None:
    if way == "version 99":
        file.attrs["format_version"] = 99
        return
    items: list[Any] = []
    file.visititems(lambda _, item: items.append(item))
    datasets = [item for item in items if isinstance(item, h5py.Dataset)]
    number = [item for item in datasets if item.dtype.kind == "f" and item.size]
    best = max(number or datasets, key=lambda item: item.size)
    if way == "a part taken out":
        del file[best.name]
    elif number:
        best[(best.shape[0] // 2,) if best.shape else ()] = np.nan if way == "NaN" else 1e30
    else:
        best[best.shape[0] // 2] = 2**31 - 1 if best.dtype.itemsize > 2 else 99


def _in_json(content: Any, way: str) -> Any:
    if isinstance(content, list):
        return content[:-1]
    if way == "version 99":
        return content | {"format_version": 99}
    key = next(iter(content))
    if way == "a part taken out":
        return {k: v for k, v in content.items() if k != key}
    number = next((k for k, v in content.items() if isinstance(v, float)), key)
    return content | {number: float("nan") if way == "NaN" else 1e30}


def _in_values(content: bytes, way: str) -> bytes:
    """Binary numbers, as in OpenFOAM's files."""
    if way == "version 99":
        return content.replace(b"version     2.0", b"version     99 ", 1) + b"\n"
    middle = len(content) // 2
    value = np.float64(np.nan if way == "NaN" else 1e30).tobytes()
    value = b"" if way == "a part taken out" else value
    return content[:middle] + value + content[middle + 8 :]


def _in_text(text: str, way: str) -> str:
    head = [line for line in text.splitlines() if line[:1] == "#"]
    rows = [line for line in text.splitlines() if line[:1] != "#"]
    if way == "version 99":
        head = [line.replace('"format_version": 1', '"format_version": 99') for line in head]
        return "\n".join([*head, *rows, "99"]) + "\n"
    cells = list(csv.reader(rows))
    if way == "a part taken out":
        cells = [row[1:] for row in cells]
    else:
        cells[len(cells) // 2][-1] = "nan" if way == "NaN" else "1e30"
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(cells)
    return "\n".join([*head, out.getvalue()])
