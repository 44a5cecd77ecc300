"""Image-sized arrays that a thread keeps from pair to pair: the system clears fresh memory at a fifth of a pair's cost."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

_kept = threading.local()
New = Callable[..., np.ndarray]
FREED = (
    31 * 2**20
)  # bytes: once so much was given back, glibc keeps smaller arrays' memory at hand, up to twice as much


def fresh(*shape: int) -> np.ndarray:
    """A new float32 array, for what is not worth keeping."""
    return np.empty(shape, np.float32)


@contextmanager
def scratch(size: tuple[int, ...]) -> Iterator[New]:
    """Yield `new(*shape)`, which gives float32 arrays of undefined content that are handed on when the context ends.

    size: of the images; arrays kept from images of another size are let go. Nothing that was given may be used later.
    """
    if getattr(_kept, "size", None) != size:
        _kept.size, _kept.free = size, {}
        np.empty(FREED, np.uint8)  # let go at once
    free: dict[tuple[int, ...], list[np.ndarray]] = _kept.free
    taken: list[np.ndarray] = []

    def new(*shape: int) -> np.ndarray:
        stack = free.get(shape)
        taken.append(stack.pop() if stack else np.empty(shape, np.float32))
        return taken[-1]

    try:
        yield new
    finally:
        for array in taken:
            free.setdefault(array.shape, []).append(array)
