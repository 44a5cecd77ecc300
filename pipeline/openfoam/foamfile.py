"""Writing OpenFOAM files whole and fast: headers, binary lists, point fields."""

import gzip
import os
import re
from pathlib import Path

import numpy as np
from numpy import ndarray

from piv.files import atomic as whole_file
from piv.files.errors import StageError

END = b"\n\n// ************************************************************************* //\n"


def header(foam_class: str, location: str, name: str, *, binary: bool, note: str = "") -> bytes:
    """The FoamFile dictionary at the top of a file."""
    arch = '    arch        "LSB;label=32;scalar=64";\n' if binary else ""
    remark = f'    note        "{note}";\n' if note else ""
    return f"""FoamFile
{{
    version     2.0;
    format      {"binary" if binary else "ascii"};
{arch}    class       {foam_class};
{remark}    location    "{location}";
    object      {name};
}}

""".encode()


def binary_list(values: ndarray) -> bytes:
    """A List in OpenFOAM's binary form: size, raw bytes in brackets; ints are 32-bit labels."""
    values = np.ascontiguousarray(values, "<i4" if values.dtype.kind in "iu" else "<f8")
    return b"%d\n(" % len(values) + values.tobytes() + b")"


def write_bytes(path: Path, content: bytes, compress: bool = False, sync: bool = True) -> None:
    """Write a file whole or not at all, on the disk first with `sync`; `compress`: <path>.gz."""
    if compress:
        path = path.with_name(path.name + ".gz")
        content = gzip.compress(content, compresslevel=1, mtime=0)
    whole_file.write_bytes(path, content, sync=sync)


def write_list(path: Path, foam_class: str, location: str, *lists: ndarray, note: str = "") -> None:
    """Write a binary list file (points, owner, faces, …)."""
    body = b"\n".join(binary_list(v) for v in lists)
    write_bytes(path, header(foam_class, location, path.name, binary=True, note=note) + body + END)


def labels_of(content: bytes) -> ndarray:
    """A labelList, ASCII or binary."""
    start = content.index(b"}", content.index(b"FoamFile")) + 1
    is_binary = b"binary" in content[:start]
    opening = content.index(b"(", start)
    count = int(content[start:opening].split()[-1])
    if is_binary:
        return np.frombuffer(content, "<i4", count, opening + 1)
    return np.array(content[opening + 1 : content.index(b")", opening)].split(), dtype=np.int64)


def is_complete(path: Path) -> bool:
    """Whether OpenFOAM finished writing a file: its last line is the closing rule."""
    with open(path, "rb") as file:
        file.seek(0, os.SEEK_END)
        file.seek(max(0, file.tell() - 200))
        return file.read().rstrip().endswith(b"* //")


def read_field(path: Path, cells: int) -> ndarray:
    """Internal values (cell,) or (cell, 3) of a binary volScalarField or volVectorField."""
    return field_of(path.read_bytes(), cells, path)


def field_of(content: bytes, cells: int, path: Path) -> ndarray:
    """The same from a field's bytes; `path` is where they are from."""
    match = re.search(
        rb"\ninternalField\s+(uniform ([^;]+);|nonuniform List<(scalar|vector)>\s*(\d+)\s*\()",
        content,
    )
    if match is None:
        raise StageError(
            f"{path}: not an OpenFOAM field; delete the case folder and run make again"
        )
    if match.group(2):
        value = np.array(match.group(2).replace(b"(", b" ").replace(b")", b" ").split(), float)
        return np.tile(value, (cells, 1)) if len(value) > 1 else np.full(cells, value[0])
    size = 3 if match.group(3) == b"vector" else 1
    values = np.frombuffer(content, "<f8", size * int(match.group(4)), match.end())
    return values.reshape(-1, 3) if size == 3 else values


def write_field(path: Path, template: Path, values: ndarray) -> None:
    """Write `template`, a field as text, with other internal values (cell,) or (cell, 3)."""
    kind, name = ("vector", "volVectorField") if values.ndim == 2 else ("scalar", "volScalarField")
    body = template.read_bytes().split(b"}", 1)[1]
    field = b"internalField nonuniform List<%s> " % kind.encode() + binary_list(values) + b";"
    head, count = re.subn(rb"internalField[^;]*;", lambda _: field, body, count=1)
    if count != 1:
        raise StageError(f"{template}: no internalField; run the case stage again")
    write_bytes(path, header(name, path.parent.name, path.name, binary=True) + head + END)


def set_number(case: Path, key: str, value: str, file: str = "numbers") -> None:
    """Change one entry of system/numbers, or of another file there."""
    path = case / "system" / file
    text, count = re.subn(rf"(?m)^{key}\s.*?;", f"{key:<23} {value};", path.read_text())
    if count != 1:
        raise StageError(f"{path}: entry {key!r} occurs {count} times; run the case stage again")
    whole_file.write_text(path, text)
