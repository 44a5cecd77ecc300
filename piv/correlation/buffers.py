"""Image-sized arrays that a thread reuses: clearing new memory costs a fifth of a pair's time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy import ndarray

_kept = threading.local()
New = Callable[..., ndarray]
# bytes: glibc keeps the memory of smaller arrays once an array of this size has been freed
_FREED = 31 * 2**20


def fresh(*shape: int) -> ndarray:
    """A new float32 array of undefined content."""
    return np.empty(shape, np.float32)


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
