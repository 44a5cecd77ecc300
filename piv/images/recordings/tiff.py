"""Pages of TIFF files (TIFF 6.0, BigTIFF), and stacks of ImageJ that have one page for all."""

import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from piv.images.recording import UnreadableFrame

TIFF_SUFFIXES = (".tif", ".tiff")
_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _DESCRIPTION, _OFFSET, _FORMAT = (
    256, 257, 258, 259, 270, 273, 339,
)  # fmt: skip
_KINDS = {1: "u", 2: "i", 3: "f"}  # of pixels, by the tag SampleFormat
_STORED = {("u", 8), ("u", 16), ("u", 32), ("i", 16), ("f", 32)}  # kind and bits


@dataclass(frozen=True)
class _Layout:
    """How a TIFF file writes numbers: codes of `struct` for counts and links, bytes of an entry."""

    order: str
    count: str
    entry: int
    link: str


@dataclass(frozen=True)
class RawStack:
    """Pictures one behind the other, without compression."""

    path: Path
    offset: int
    shape: tuple[int, int]
    dtype: np.dtype
    count: int

    def page(self, k: int) -> np.ndarray:
        """Picture `k`, in the byte order of this machine."""
        size = self.shape[0] * self.shape[1]
        offset = self.offset + k * size * self.dtype.itemsize
        values = np.fromfile(self.path, self.dtype, size, offset=offset)
        return values.reshape(self.shape).astype(self.dtype.newbyteorder("="))


def _begin(file: BinaryIO, path: Path) -> tuple[_Layout, bytes]:
    """Layout of a file, and the link to its first directory; UnreadableFrame."""
    head = file.read(16)
    order = {b"II": "<", b"MM": ">"}.get(head[:2])
    if order is None or len(head) < 8:
        raise _broken(path)
    if struct.unpack(order + "H", head[2:4])[0] == 43:
        return _Layout(order, order + "Q", 20, order + "Q"), head[8:16]
    return _Layout(order, order + "H", 12, order + "I"), head[4:8]


def _broken(path: Path) -> UnreadableFrame:
    return UnreadableFrame(f"{path}: not readable as a TIFF image (damaged, or another format)")


def tiff_pages(path: Path) -> int:
    """Number of pages by the chain of directories; UnreadableFrame where it is broken.

    OpenCV's own count stops silently at a break, so that half a stack would pass for a whole one.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        layout, link = _begin(file, path)
        count_size, link_size = struct.calcsize(layout.count), struct.calcsize(layout.link)
        seen: set[int] = set()
        while len(link) == link_size and (offset := struct.unpack(layout.link, link)[0]) != 0:
            if offset > size:
                raise _broken(path)
            file.seek(offset)
            number = file.read(count_size)
            if offset in seen or len(number) < count_size:
                raise _broken(path)
            seen.add(offset)
            end = offset + count_size + struct.unpack(layout.count, number)[0] * layout.entry
            if end + link_size > size:
                raise _broken(path)
            file.seek(end)
            link = file.read(link_size)
    if not seen:
        raise _broken(path)
    return len(seen)


def raw_stack(path: Path) -> RawStack | None:
    """The stack in a file of ImageJ that has one page for all pictures, else None.

    ImageJ writes stacks of more than 4 GB so. UnreadableFrame where pictures are cut off.
    """
    if path.suffix.lower() not in TIFF_SUFFIXES:
        return None
    with path.open("rb") as file:
        layout, link = _begin(file, path)
        try:
            tags = _tags(file, layout, struct.unpack(layout.link, link)[0])
        except struct.error:
            return None
        text = b""
        if _DESCRIPTION in tags:
            length, at = tags[_DESCRIPTION]
            file.seek(at)
            text = file.read(min(length, 4096))
    found = re.search(rb"^ImageJ=.*?^images=(\d+)", text, re.MULTILINE | re.DOTALL)
    count = int(found.group(1)) if found else 1
    one = {name: value for name, (number, value) in tags.items() if number == 1}
    kind = (_KINDS.get(one.get(_FORMAT, 1)), one.get(_BITS, 8))
    if count < 2 or one.get(_COMPRESSION, 1) != 1 or kind not in _STORED or _OFFSET not in one:
        return None
    dtype = np.dtype(f"{layout.order}{kind[0]}{kind[1] // 8}")
    shape = one.get(_HEIGHT, 0), one.get(_WIDTH, 0)
    if path.stat().st_size < one[_OFFSET] + count * shape[0] * shape[1] * dtype.itemsize:
        raise UnreadableFrame(
            f"{path}: ends before the last of its {count} pictures; copy it again"
        )
    return RawStack(path, one[_OFFSET], shape, dtype, count)


def _tags(file: BinaryIO, layout: _Layout, offset: int) -> dict[int, tuple[int, int]]:
    """Count and value, or place of the values, of each tag of a directory."""
    file.seek(offset)
    (number,) = struct.unpack(layout.count, file.read(struct.calcsize(layout.count)))
    tags = {}
    for _ in range(min(number, 4096)):
        entry = file.read(layout.entry)
        tag, kind = struct.unpack_from(layout.order + "HH", entry)
        (count,) = struct.unpack_from(layout.link, entry, 4)
        value = entry[4 + struct.calcsize(layout.link) :]
        code = {1: "B", 3: "H", 4: "I", 16: "Q"}.get(kind) if count == 1 else layout.link[1]
        if code is not None:
            tags[tag] = (count, struct.unpack_from(layout.order + code, value)[0])
    return tags
