"""Recordings that are image files, one frame or several in each."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy import ndarray

from piv.images.file_names import pairing_by_name, with_missing
from piv.images.recording import Recording, UnreadableFrame
from piv.images.recordings.tiff import TIFF_SUFFIXES, RawStack, raw_stack, tiff_pages

JPEG_SUFFIXES = (".jpg", ".jpeg")
COLOURS = ("refuse", "luma", "green")


def to_grey(image: ndarray, colour: str, name: str) -> ndarray:
    """2-D uint8, uint16 or float32 from a decoded image; equal channels are one, alpha is ignored.

    Other numbers, such as those of int16, uint32 and float TIFF, become float32 as they are.

    Really coloured images need a rule: "luma" (Rec. 601) or "green" (the sharpest channel of a
    Bayer sensor under green laser light); with "refuse" they raise ValueError.
    """
    if image.dtype.kind not in "uif":
        raise ValueError(f"{name}: pixels are {image.dtype}; save them as grey TIFF")
    if image.dtype not in (np.uint8, np.uint16):
        image = image.astype(np.float32)
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
    """Image files in their order, TIFF stacks page by page."""

    def __init__(self, paths: Sequence[Path], *, colour: str = "refuse") -> None:
        self.broken: dict[Path, UnreadableFrame] = {}
        self._stacks: dict[Path, RawStack] = {}  # of ImageJ, which other programs see as one page
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
            if (count := _page_count(path)) == 1 and (stack := raw_stack(path)) is not None:
                self._stacks[path], count = stack, stack.count
            return count
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
        if path in self._stacks:
            return to_grey(self._stacks[path].page(page), self.colour, self.frame_name(i))
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
    return tiff_pages(path) if suffix in TIFF_SUFFIXES else 1


def _common_name(paths: Sequence[Path]) -> str:
    return str(paths[0]) if len(paths) == 1 else f"{paths[0]} ... {paths[-1].name}"
