"""Recordings that are image files, one frame or several in each."""

import struct
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy import ndarray

from piv.images.file_names import pairing_by_name, with_missing
from piv.images.recording import Recording, UnreadableFrame

JPEG_SUFFIXES = (".jpg", ".jpeg")
COLOURS = ("refuse", "luma", "green")


def to_grey(image: ndarray, colour: str, name: str) -> ndarray:
    """2-D uint8/uint16 from a decoded image; equal channels are one, alpha is ignored.

    Really coloured images need a rule: "luma" (Rec. 601) or "green" (the sharpest channel of a
    Bayer sensor under green laser light); with "refuse" they raise ValueError.
    """
    if image.dtype not in (np.uint8, np.uint16):
        raise ValueError(
            f"{name}: pixels are {image.dtype}; convert to 8 or 16 bit unsigned integers"
        )
    if image.ndim == 2:
        return image
    if image.shape[2] < 3:  # grey and alpha
        return image[:, :, 0]
    blue, green, red = image[:, :, 0], image[:, :, 1], image[:, :, 2]
    if np.array_equal(blue, green) and np.array_equal(red, green):
        return np.ascontiguousarray(green)
    if colour == "luma":
        return cv2.cvtColor(np.ascontiguousarray(image[:, :, :3]), cv2.COLOR_BGR2GRAY)
    if colour == "green":
        return np.ascontiguousarray(green)
    raise ValueError(
        f"{name}: a colour image; say with colour 'luma' or 'green' how to make it grey"
    )


class ImageFiles(Recording):
    """Image files in their order, TIFF stacks page by page (8 to 16 bit)."""

    def __init__(self, paths: Sequence[Path], *, colour: str = "refuse") -> None:
        self.broken: dict[Path, UnreadableFrame] = {}
        pages = [(p, k) for p in paths for k in range(self._count(p, len(paths) == 1))]
        pairing, doubt = pairing_by_name(paths)
        if len(pages) == len(paths):
            pages = [(p, 0) for p in with_missing(paths, pairing)]
        super().__init__(_common_name(paths), len(pages))
        self.pages = pages
        self.files = tuple(paths)
        present = set(paths)
        self.missing = frozenset(i for i, (path, _) in enumerate(pages) if path not in present)
        self.colour = colour
        self.pairing, self.pairing_doubt = pairing, doubt
        self.lossy = any(p.suffix.lower() in JPEG_SUFFIXES for p in paths)

    def _count(self, path: Path, alone: bool) -> int:
        """Frames in a file; 1 of a damaged one among others, whose frame then cannot be read."""
        try:
            return _page_count(path)
        except UnreadableFrame as error:
            if alone:
                raise
            self.broken[path] = error
            return 1

    def frame_name(self, i: int) -> str:
        path, page = self.pages[i]
        return f"{path}: page {page}" if page else str(path)

    def _read(self, i: int) -> ndarray:
        path, page = self.pages[i]
        if i in self.missing:
            raise UnreadableFrame(f"{path}: this picture is missing, its neighbours are there")
        if path in self.broken:
            raise self.broken[path]
        try:
            done, images = cv2.imreadmulti(
                str(path), start=page, count=1, flags=cv2.IMREAD_UNCHANGED
            )
        except cv2.error:
            done, images = False, ()
        if not done or not len(images):
            raise UnreadableFrame(
                f"{self.frame_name(i)}: not readable as an image (damaged, or another format); "
                "save it anew as TIFF or PNG"
            )
        return to_grey(images[0], self.colour, self.frame_name(i))


def _page_count(path: Path) -> int:
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    suffix = path.suffix.lower()
    if suffix in JPEG_SUFFIXES and b"\xff\xd9" not in path.read_bytes()[-1024:]:
        raise UnreadableFrame(
            f"{path}: the JPEG image is cut off; copy it again, or leave it out"
        )  # OpenCV would fill the rest with grey
    return _tiff_pages(path) if suffix in (".tif", ".tiff") else 1


def _tiff_pages(path: Path) -> int:
    """Number of pages by the chain of directories (TIFF 6.0, BigTIFF); ValueError if broken.

    OpenCV's own count stops silently at a break, so that half a stack would pass for a whole one.
    """
    size = path.stat().st_size
    broken = UnreadableFrame(f"{path}: not readable as a TIFF image (damaged, or another format)")
    with path.open("rb") as file:
        head = file.read(16)
        order = {b"II": "<", b"MM": ">"}.get(head[:2])
        if order is None or len(head) < 8:
            raise broken
        big = struct.unpack(order + "H", head[2:4])[0] == 43
        count_code, entry, link_code = ("Q", 20, "Q") if big else ("H", 12, "I")
        count_code, link_code = order + count_code, order + link_code
        count_size, link_size = struct.calcsize(count_code), struct.calcsize(link_code)
        link = head[8:16] if big else head[4:8]
        seen: set[int] = set()
        while (offset := struct.unpack(link_code, link)[0]) != 0:
            if offset > size:
                raise broken
            file.seek(offset)
            number = file.read(count_size)
            if offset in seen or len(number) < count_size:
                raise broken
            seen.add(offset)
            end = offset + count_size + struct.unpack(count_code, number)[0] * entry
            if end + link_size > size:
                raise broken
            file.seek(end)
            link = file.read(link_size)
    if not seen:
        raise broken
    return len(seen)


def _common_name(paths: Sequence[Path]) -> str:
    return str(paths[0]) if len(paths) == 1 else f"{paths[0]} ... {paths[-1].name}"
