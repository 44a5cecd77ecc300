"""Images of a pair or set prepared for correlation: checked, without background."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy import ndarray

from piv.correlation.buffers import New, fresh
from piv.correlation.deform import Image
from piv.correlation.prefilter import remove_background

SMALLEST = 32  # px: fewer do not hold two windows
# px: with 0.005 particles per px, one such rectangle in 100,000 holds none
FLAT = ((48, 48), (96, 24), (24, 96))


class BlankImage(ValueError):
    """An image that shows nothing where it is not masked."""


def check_images(images: list[Any], window: float) -> list[ndarray]:
    """The images as 2-D arrays; ValueError where they cannot be correlated."""
    arrays = [np.asarray(i) for i in images]
    for a in arrays:
        if a.ndim != 2:
            raise ValueError(
                f"images must be 2-D grey values, got shape {a.shape}; convert colour to grey first"
            )
        if a.dtype.kind not in "uifb":
            raise ValueError(f"images must hold real numbers, got {a.dtype}")
        if a.shape != arrays[0].shape:
            raise ValueError(f"images must be of one shape, got {arrays[0].shape} and {a.shape}")
    if min(arrays[0].shape) < max(SMALLEST, window):
        raise ValueError(
            f"images of {arrays[0].shape[1]}x{arrays[0].shape[0]} px are too small for a window of "
            f"{window:g} px; "
            f"at least {int(np.ceil(max(SMALLEST, window)))} px each way are needed"
        )
    return arrays


def check_masks(mask: Any, count: int, shape: tuple[int, int]) -> list[ndarray | None]:
    """One mask (True = body) or None per image from None, one array for all, or one per image."""
    if mask is None:
        return [None] * count
    masks = list(mask) if isinstance(mask, tuple | list) else [mask] * count
    if len(masks) != count:
        raise ValueError(f"give one mask, or one per image: got {len(masks)} for {count} images")
    out: list[ndarray | None] = []
    for m in masks:
        if m is not None:
            m = np.asarray(m)
            if m.shape != shape:
                raise ValueError(f"the mask is of shape {m.shape}, the images of {shape}")
            m = m.astype(bool)
        out.append(m)
    return out


def _flat_areas(image: ndarray) -> ndarray | None:
    """Pixels (bool) in rectangles of FLAT of one grey level, painted over or padded, or None."""
    apart = 8
    samples = np.ascontiguousarray(image[::apart, ::apart])
    if samples.dtype.name not in ("uint8", "uint16", "float32"):
        return None
    flat = np.zeros(image.shape, bool)
    for shape in FLAT:
        if _constant(samples, np.ones([n // apart - 1 for n in shape], np.uint8)).any():
            box = np.ones(shape, np.uint8)
            # a rectangle of even sides is eroded and dilated about opposite corners of its middle
            middle = (shape[1] // 2 - 1, shape[0] // 2 - 1)
            flat |= cv2.dilate(_constant(image, box).astype(np.uint8), box, anchor=middle) > 0
    return flat if flat.any() and not flat.all() else None


def _constant(image: ndarray, box: ndarray) -> ndarray:
    return cv2.dilate(image, box) == cv2.erode(image, box)


class Prepared:
    """Several images without background, and their unmasked pixels."""

    def __init__(self, images: list[Any], mask: Any, window: float, new: New = fresh):
        self.new = new
        arrays = check_images(images, window)
        self.shape = arrays[0].shape
        masks = check_masks(mask, len(arrays), self.shape)
        self.seen = [None if m is None else ~m for m in masks]
        pixels, levels = [], []
        for k, image in enumerate(arrays):
            if (flat := _flat_areas(image)) is not None:
                self.seen[k] = ~flat if self.seen[k] is None else self.seen[k] & ~flat
            grey = new(*self.shape)
            grey[...] = image
            image, seen = grey, self.seen[k]
            # a sum is finite only where every term is, and costs one pass
            finite = np.isfinite(image) if not np.isfinite(cv2.sumElems(image)[0]) else None
            if finite is not None:
                bad = ~finite if seen is None else ~finite & seen
                if bad.any():
                    raise ValueError(
                        f"image {k + 1} holds {int(bad.sum())} pixels that are not finite; mask "
                        "them"
                    )
                image = np.where(finite, image, 0)
            levels.append(cv2.norm(image, cv2.NORM_INF))
            pixels.append(remove_background(image, seen, new))
        energy = float(np.sqrt(np.mean([cv2.norm(p) ** 2 / p.size for p in pixels])))
        for k, p in enumerate(pixels):
            seen = self.seen[k]
            if (seen is None or seen.any()) and not cv2.norm(p, cv2.NORM_INF) > 1e-6 * levels[k]:
                raise BlankImage(
                    f"image {k + 1} is of one grey level where it is not masked; give a picture "
                    "with particles, "
                    "or a mask that leaves them"
                )
        self.pixels = [
            np.multiply(p, np.float32(1 / energy), out=p) if energy > 0 else p for p in pixels
        ]
        self._images: dict[int, list[Image]] = {}

    @cached_property
    def half(self) -> tuple[list[ndarray], list[ndarray | None]]:
        """Pixels and maps of unmasked pixels at half resolution."""
        rows, columns = self.shape[0] // 2, self.shape[1] // 2

        def coarser(field: ndarray) -> ndarray:
            return cv2.resize(
                field[: 2 * rows, : 2 * columns], (columns, rows), interpolation=cv2.INTER_AREA
            )

        seen = [None if s is None else coarser(s.astype(np.float32)) > 0.99 for s in self.seen]
        return [coarser(p) for p in self.pixels], seen

    def images(self, factor: int) -> list[Image]:
        """The images at full (1) or half (2) resolution, to be filtered before they are sampled."""
        if factor not in self._images:
            arrays = (self.pixels, self.seen) if factor == 1 else self.half
            self._images[factor] = [Image(p, s, self.new) for p, s in zip(*arrays, strict=True)]
        return self._images[factor]
