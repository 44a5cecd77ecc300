"""Images of a pair or set prepared for correlation: checked, without background."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property, lru_cache
from typing import Any

import cv2
import numpy as np
from numpy import float32, ndarray

from piv.correlation.interpolate import PAD, warp
from piv.correlation.options import Options
from piv.correlation.prefilter import TAPS, Kernel, apply

BOX = 7  # px at half resolution: of the local mean
SMALLEST = 32  # px: fewer do not hold two windows
# px: with 0.005 particles per px, one such rectangle in 100,000 holds none
FLAT = ((48, 48), (96, 24), (24, 96))

_kept = threading.local()  # image-sized arrays: clearing new memory costs a fifth of a pair's time
# bytes: glibc keeps the memory of smaller arrays once an array of this size has been freed
_FREED = 31 * 2**20


New = Callable[..., ndarray]  # of a shape: a float32 array of undefined content


def fresh(*shape: int) -> ndarray:
    """A new float32 array of undefined content."""
    return np.empty(shape, float32)


class BlankImage(ValueError):
    """An image that shows nothing where it is not masked."""


@contextmanager
def image_buffers(size: tuple[int, ...]) -> Iterator[New]:
    """Yield `new(*shape)`: float32 arrays of undefined content, reused after the context ends.

    size: of the images; arrays for another size are freed. Do not use an array after the context.
    """
    if getattr(_kept, "size", None) != size:
        _kept.size, _kept.free = size, {}
        np.empty(_FREED, np.uint8)  # freed at once
    free: dict[tuple[int, ...], list[ndarray]] = _kept.free
    taken: list[ndarray] = []

    def new(*shape: int) -> ndarray:
        stack = free.get(shape)
        taken.append(stack.pop() if stack else np.empty(shape, np.float32))
        return taken[-1]

    try:
        yield new
    finally:
        for array in taken:
            free.setdefault(array.shape, []).append(array)


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


def remove_background(image: ndarray, seen: ndarray | None, new: New = fresh) -> ndarray:
    """Image (float32) minus its local mean (a triangle of 4·BOX px), zero where `seen` is False.

    Only seen pixels enter the local mean, which is smooth enough to be taken at half resolution.
    """
    shape = image.shape[1], image.shape[0]

    def blur(field):
        coarse = cv2.resize(field, (shape[0] // 2, shape[1] // 2), interpolation=cv2.INTER_AREA)
        return cv2.blur(cv2.blur(coarse, (BOX, BOX)), (BOX, BOX))

    weight = None if seen is None else seen.astype(np.float32)
    mean = blur(image) if weight is None else blur(image * weight) / np.maximum(blur(weight), 1e-6)
    out = cv2.resize(mean, shape, dst=new(*image.shape), interpolation=cv2.INTER_LINEAR)
    np.subtract(image, out, out=out)
    if seen is not None:
        out[~seen] = 0
    return out


def inside(seen: ndarray) -> ndarray:
    """Padded map (uint8) of the pixels whose sample and derivatives use unmasked pixels only."""
    usable = cv2.copyMakeBorder(
        seen.astype(np.uint8), PAD, PAD, PAD, PAD, cv2.BORDER_CONSTANT, value=(0,)
    )
    # a sample needs its four neighbours, a derivative those of its own neighbours: 4 px in all
    return cv2.erode(usable, np.ones((9, 9), np.uint8))


@lru_cache(8)
def _usable_samples(shape: tuple[int, int]) -> ndarray:
    """`inside` of an image without a mask; shared, read only."""
    return inside(np.ones(shape, bool))


class Image:
    """One image at one resolution, filtered and ready to be sampled anywhere."""

    def __init__(self, pixels: ndarray, seen: ndarray | None, new: New = fresh):
        """pixels: float32 without background; seen: unmasked pixels. Call `filter` next."""
        self.pixels = pixels
        self.usable = _usable_samples(pixels.shape) if seen is None else inside(seen)
        self.warped = new(*pixels.shape)
        self.samples = new(*(n + 2 * PAD for n in pixels.shape))
        self.samples[:PAD] = self.samples[-PAD:] = self.samples[:, :PAD] = self.samples[
            :, -PAD:
        ] = 0
        self._kernel: Kernel | None = None

    def filter(self, kernel: Kernel) -> None:
        """Filter the pixels for sampling, unless this kernel was the last one."""
        if kernel is not self._kernel:
            apply(self.pixels, kernel, self.samples[PAD:-PAD, PAD:-PAD])
            self._kernel = kernel

    def filter_rows(self, kernel: Kernel, first: int, last: int) -> None:
        """Filter rows `first` to `last` only; `filter` then starts anew."""
        rows = self.pixels.shape[0]
        first, last = max(first, 0), min(last, rows)
        low, high = max(first - TAPS, 0), min(last + TAPS, rows)
        part = apply(self.pixels[low:high], kernel)
        self.samples[PAD + first : PAD + last, PAD:-PAD] = part[first - low : last - low]
        self._kernel = None

    def crop(self, top: int, bottom: int, left: int, right: int) -> Image:
        """A copy of a part of the filtered image, with PAD px around it for samples."""
        part = object.__new__(Image)
        padded = (slice(top, bottom + 2 * PAD), slice(left, right + 2 * PAD))
        part.pixels = self.pixels[top:bottom, left:right]
        part.usable, part.samples = self.usable[padded].copy(), self.samples[padded].copy()
        return part

    def warp(
        self,
        dx: ndarray,
        dy: ndarray,
        share: float,
        weight: ndarray,
        multiply: bool,
        first: int = 0,
    ) -> ndarray:
        """Rows from `first` on, sampled along `share` of a displacement (interpolate.warp)."""
        out = self.warped[first : first + dx.shape[0]]
        warp(self.samples, self.usable, dx, dy, share, first, out, weight, multiply)
        return out


class Prepared:
    """Several images without background, and their unmasked pixels."""

    def __init__(self, images: list[Any], mask: Any, options: Options, new: New = fresh):
        self.options, self.new = options, new
        arrays = check_images(images, options.window)
        self.shape = arrays[0].shape
        masks = check_masks(mask, len(arrays), self.shape)
        self.unmasked = [None if m is None else ~m for m in masks]
        pixels, levels = [], []
        for k, image in enumerate(arrays):
            if (flat := _flat_areas(image)) is not None:
                self.unmasked[k] = ~flat if self.unmasked[k] is None else self.unmasked[k] & ~flat
            grey = new(*self.shape)
            grey[...] = image
            image, seen = grey, self.unmasked[k]
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
            seen = self.unmasked[k]
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
    def half(self) -> list[ndarray]:
        """Pixels at half resolution."""
        return [_half(p) for p in self.pixels]

    @cached_property
    def half_unmasked(self) -> list[ndarray | None]:
        """Pixels (bool) at half resolution that are not masked; None without a mask."""
        return [None if s is None else _half(s.astype(np.float32)) > 0.99 for s in self.unmasked]

    def images(self, factor: int) -> list[Image]:
        """The images at full (1) or half (2) resolution, to be filtered before they are sampled."""
        if factor not in self._images:
            pixels = self.pixels if factor == 1 else self.half
            masks = self.unmasked if factor == 1 else self.half_unmasked
            self._images[factor] = [
                Image(p, m, self.new) for p, m in zip(pixels, masks, strict=True)
            ]
        return self._images[factor]

    def common(self, factor: int) -> ndarray | None:
        """Pixels (bool) that no image masks, at full (1) or half (2) resolution; None: all."""
        masks = self.unmasked if factor == 1 else self.half_unmasked
        some = [m for m in masks if m is not None]
        return np.logical_and.reduce(some) if some else None


def _half(field: ndarray) -> ndarray:
    rows, columns = field.shape[0] // 2, field.shape[1] // 2
    part = field[: 2 * rows, : 2 * columns]
    return cv2.resize(part, (columns, rows), interpolation=cv2.INTER_AREA)
