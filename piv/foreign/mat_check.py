"""Whether a MAT 5 file's variables are sound: on some damaged files scipy's compiled reader ends the process.

scipy takes a data type from the file as an index into a table without looking whether it is in there, follows cells in
cells without end, and reads the cells of an array one after the other whatever length each states. So all of it is
walked first, in the order in which scipy reads. Source: MathWorks, MAT-File Format, "Level 5 MAT-File Format".
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Collection
from math import prod
from pathlib import Path
from typing import BinaryIO

NUMBERS = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}  # data type: bytes of an item
TEXTS = (1, 2, 4, 16, 17, 18)  # int8, uint8, uint16, UTF-8, UTF-16, UTF-32
INT8, INT32, UINT32, MATRIX, COMPRESSED, UTF8 = 1, 5, 6, 14, 15, 16  # data types
CELL, CHAR, NUMERIC, OPAQUE = 1, 4, range(6, 16), 17  # classes of arrays; those up to 18 exist
COMPLEX = 0x800  # bit of the array flags
MOST_AXES = 32  # of a numpy array that scipy makes
DEEPEST = 8  # cells in cells; PIVlab's are one deep
LARGEST = 2**31  # bytes of a variable, the format's own limit
LONGEST_NAME = 4096  # bytes; MATLAB's own names have at most 63
CHUNK = 1 << 16  # bytes


def check_mat(path: str | Path, wanted: Collection[str]) -> list[str]:
    """Names among `wanted` that a MAT 5 file holds, all sound; ValueError with one sentence where the file is damaged.

    Of the other variables only the header is looked at: to be read with `loadmat(path, variable_names=...)`.
    """
    with open(path, "rb") as file:
        size = os.fstat(file.fileno()).st_size
        head = file.read(128)
        if len(head) >= 4 and 0 in head[:4]:
            raise ValueError(f"{path}: not a MAT 5 file (MAT 4 is not read); save it with -v7 or -v7.3")
        order = {b"\x00\x01IM": "<", b"\x01\x00MI": ">"}.get(head[124:])
        if order is None:
            raise ValueError(f"{path}: not a MAT 5 file: no version 1 and byte order in its header")
        found: list[str] = []
        try:
            while file.tell() < size:
                name = _check_variable(file, size, order, wanted)
                if name in wanted and name not in found:
                    found.append(name)
        except (_Damage, zlib.error) as error:
            raise ValueError(f"{path}: damaged, or not a .mat export of PIVlab: {error}") from None
    return found


class _Damage(Exception):
    """What is wrong, without the file's name."""


class _Inflated(io.RawIOBase):
    """What a compressed element of `size` bytes holds, a chunk at a time."""

    def __init__(self, file: BinaryIO, size: int) -> None:
        self.file, self.left, self.zlib = file, size, zlib.decompressobj()

    def readable(self) -> bool:
        return True

    def readinto(self, into) -> int:
        while not self.zlib.eof:
            more = self.zlib.unconsumed_tail
            if not more and self.left:
                more = self.file.read(min(CHUNK, self.left))
                self.left -= len(more)
            out = self.zlib.decompress(more, len(into))
            if out or not more:
                into[: len(out)] = out
                return len(out)
        return 0


class _Elements:
    """Tags and data in a row, each within `end` bytes from the first."""

    def __init__(self, file: BinaryIO, order: str, size: int) -> None:
        self.file, self.order, self.end, self.at = file, order, size, 0

    def take(self, count: int) -> bytes:
        got = self.file.read(count)
        self.at += count
        if len(got) < count or self.at > self.end:
            raise _Damage("it ends within an element")
        return got

    def skip(self, count: int) -> None:
        if self.file.seekable():
            self.file.seek(count, os.SEEK_CUR)
            self.at += count
            if self.at > self.end:
                raise _Damage("it ends within an element")
            return
        while count > 0:
            count -= len(self.take(min(CHUNK, count)))

    def numbers(self, content: bytes, kind: str) -> tuple[int, ...]:
        return struct.unpack(f"{self.order}{len(content) // 4}{kind}", content)

    def full_tag(self) -> tuple[int, int]:
        kind, count = self.numbers(self.take(8), "I")
        if count > self.end - self.at:
            raise _Damage(f"an element of {count} bytes where {self.end - self.at} are left")
        return kind, count

    def element(self, longest: int | None = None) -> tuple[int, int, bytes]:
        """(data type, bytes, content) of a full or a small element; no content where it is longer than `longest`."""
        head = self.take(8)
        kind, count = self.numbers(head, "I")
        if kind >> 16:  # small: type and size in the first four bytes, data in the others
            if kind >> 16 > 4:
                raise _Damage("a small element of more than four bytes")
            return kind & 0xFFFF, kind >> 16, head[4 : 4 + (kind >> 16)]
        if count > self.end - self.at:
            raise _Damage(f"an element of {count} bytes where {self.end - self.at} are left")
        content = b""
        if longest is None:
            self.skip(count)
        elif count > longest:
            raise _Damage(f"{count} bytes where at most {longest} belong")
        else:
            content = self.take(count)
        self.skip(-count % 8)
        return kind, count, content


def _check_variable(file: BinaryIO, size: int, order: str, wanted: Collection[str]) -> str:
    """Name of the variable at the file's position, checked whole where it is wanted; the position is then behind it."""
    top = _Elements(file, order, size - file.tell())
    kind, count = top.full_tag()
    behind = file.tell() + count
    if kind == COMPRESSED:
        inside = io.BufferedReader(_Inflated(file, count), CHUNK)
        elements = _Elements(inside, order, LARGEST)
        kind, count = elements.full_tag()
    else:
        elements = _Elements(file, order, count)
        elements.end += elements.at
    if kind != MATRIX or count == 0:
        raise _Damage(f"element of type {kind} and {count} bytes where a variable belongs")
    compressed = elements.file is not file
    elements.end = elements.at + count
    flags, shape, name = _header(elements)
    if name in wanted:
        try:
            _check_content(elements, flags, shape, 0)
            if elements.at != elements.end or (compressed and elements.file.read(1)):
                raise _Damage("there is more in it than its dimensions say")
        except _Damage as error:
            raise _Damage(f"variable {name!r}: {error}") from None
    file.seek(behind)
    return name


def _header(elements: _Elements) -> tuple[int, tuple[int, ...], str]:
    """(array flags with the class in the lowest byte, dimensions, name) of a matrix."""
    if elements.numbers(elements.take(8), "I") != (UINT32, 8):
        raise _Damage("no array flags where a matrix begins")
    flags = elements.numbers(elements.take(8), "I")[0]
    shape: tuple[int, ...] = ()
    if flags & 0xFF != OPAQUE:
        kind, count, content = elements.element(4 * MOST_AXES)
        if kind not in (INT32, UINT32) or count % 4 or count < 8:
            raise _Damage("no dimensions of a matrix")
        shape = elements.numbers(content, "i")
        if min(shape) < 0:
            raise _Damage(f"dimensions {_times(shape)}")
    kind, _, text = elements.element(LONGEST_NAME)
    if kind not in (INT8, UTF8) or not text.isascii():
        raise _Damage("no name of a matrix")
    return flags, shape, text.decode("ascii")


def _check_content(elements: _Elements, flags: int, shape: tuple[int, ...], depth: int) -> None:
    """Numbers, characters or cells of a matrix whose header is read; all else is no PIVlab export's."""
    kind, items = flags & 0xFF, prod(shape)
    if kind in NUMERIC:
        if flags & COMPLEX:
            raise _Damage("complex numbers, where vectors are real")
        data, count, _ = elements.element()
        if data not in NUMBERS:
            raise _Damage(f"numbers of the data type {data}, which does not exist")
        if count != items * NUMBERS[data]:
            raise _Damage(f"{count} bytes of data type {data} do not make {_times(shape)} numbers")
    elif kind == CHAR:
        data, count, _ = elements.element()
        if data not in TEXTS:
            raise _Damage(f"characters of the data type {data}, which has none")
        if items > max(count, LONGEST_NAME):  # scipy writes that many blanks where there are no bytes
            raise _Damage(f"{count} bytes do not make {_times(shape)} characters")
    elif kind == CELL:
        if depth == DEEPEST:
            raise _Damage(f"cells in cells, more than {DEEPEST} deep")
        if items > (elements.end - elements.at) // 8:
            raise _Damage(f"{elements.end - elements.at} bytes do not make {_times(shape)} cells")
        for _ in range(items):
            _check_cell(elements, depth + 1)
    else:
        raise _Damage(f"an array of the class {kind}, where numbers, characters or cells belong")


def _check_cell(elements: _Elements, depth: int) -> None:
    kind, count = elements.full_tag()
    if kind != MATRIX:
        raise _Damage(f"data of the type {kind} where a cell's matrix belongs")
    if count == 0:  # []
        return
    parent, elements.end = elements.end, elements.at + count
    _check_content(elements, *_header(elements)[:2], depth)
    if elements.at != elements.end:
        raise _Damage("a cell is longer than its dimensions say")
    elements.end = parent


def _times(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape[:4])) + (" x ..." if len(shape) > 4 else "")
