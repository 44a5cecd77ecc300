"""Recordings that are image files, one frame or several in each."""

import re
import struct
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy import ndarray

from piv.files.json_text import natural_key
from piv.images.recording import Recording

JPEG_SUFFIXES = (".jpg", ".jpeg")
PAIRINGS = ("1-2,2-3", "1-2,3-4")
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
        pages = [(p, k) for p in paths for k in range(_page_count(p))]
        super().__init__(_common_name(paths), len(pages))
        self.pages = pages
        self.colour = colour
        self.pairing, self.pairing_doubt = _pairing_by_name(paths)
        self.lossy = any(p.suffix.lower() in JPEG_SUFFIXES for p in paths)

    def _frame_name(self, i: int) -> str:
        path, page = self.pages[i]
        return f"{path}: page {page}" if page else str(path)

    def _read(self, i: int) -> ndarray:
        path, page = self.pages[i]
        try:
            done, images = cv2.imreadmulti(
                str(path), start=page, count=1, flags=cv2.IMREAD_UNCHANGED
            )
        except cv2.error:
            done, images = False, ()
        if not done or not len(images):
            raise ValueError(
                f"{self._frame_name(i)}: not readable as an image (damaged, or another format); "
                "save it anew as TIFF or PNG"
            )
        return to_grey(images[0], self.colour, self._frame_name(i))


_EXPOSURE = re.compile(r"(.*(?:[_\-. ]|\d))([ABab])|(.*[_\-])([012])")
_PARTNERS = ({"A", "B"}, {"a", "b"}, {"0", "1"}, {"1", "2"})


def _exposure_of(path: Path) -> tuple[str, str] | None:
    """Name of the pair and label of the exposure: im_07_A -> "im_07_", "A"; None without one."""
    match = _EXPOSURE.fullmatch(path.stem)
    return None if match is None else (match[1] or match[3], match[2] or match[4])


def in_couples(paths: Sequence[Path]) -> list[Path]:
    """Files in natural order, the exposures of a pair side by side where all names have a label."""
    labels = {p: _exposure_of(p) for p in paths}
    if all(labels.values()):
        return sorted(paths, key=lambda p: (natural_key((labels[p] or "")[0]), labels[p]))
    return sorted(paths, key=natural_key)


def _pairing_by_name(paths: Sequence[Path]) -> tuple[str | None, str]:
    """The pairing that names such as im_07_A, im_07_B state, else "1-2,2-3".

    None with a sentence where the names speak of two exposures and one of a pair is not there.
    """
    neighbours, couples = PAIRINGS
    found = [_exposure_of(p) for p in paths]
    names = [f for f in found if f is not None]
    labels = {label for _, label in names}
    partners = next((p for p in _PARTNERS if labels <= p), None)
    if len(names) < len(paths) or partners is None or len({name for name, _ in names}) < 2:
        return neighbours, ""
    number = {(path.parent, name) for path, (name, _) in zip(paths, names, strict=True)}
    if len(labels) == 2 and 2 * len(number) == len(paths):
        first, second = sorted(partners)
        if all(
            a[0] == b[0] and (a[1], b[1]) == (first, second)
            for a, b in zip(names[::2], names[1::2], strict=True)
        ):
            return couples, ""
        return None, (
            f"{paths[0]} ...: the names are of pairs, but not in the order of pairs; give the "
            "folder or a pattern, or --pairing"
        )
    for path, (name, label) in zip(paths, names, strict=True):
        for other in partners - {label}:
            partner = path.with_name(f"{name}{other}{path.suffix}")
            if partner in paths or (len(labels) == 1 and not partner.exists()):
                continue
            return None, (
                f"{path}: the name is of one exposure of a pair, and {partner.name} is not among "
                "the images; add it (a pattern that takes both, such as "
                f"'*{path.suffix}'), or say with --pairing how they go together"
            )
    return neighbours, ""


def _page_count(path: Path) -> int:
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    suffix = path.suffix.lower()
    if suffix in JPEG_SUFFIXES and b"\xff\xd9" not in path.read_bytes()[-1024:]:
        raise ValueError(
            f"{path}: the JPEG image is cut off; copy it again, or leave it out"
        )  # OpenCV would fill the rest with grey
    return _tiff_pages(path) if suffix in (".tif", ".tiff") else 1


def _tiff_pages(path: Path) -> int:
    """Number of pages by the chain of directories (TIFF 6.0, BigTIFF); ValueError if broken.

    OpenCV's own count stops silently at a break, so that half a stack would pass for a whole one.
    """
    size = path.stat().st_size
    broken = ValueError(f"{path}: not readable as a TIFF image (damaged, or another format)")
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
