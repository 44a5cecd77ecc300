"""Image-sized arrays that a thread reuses from pair to pair: new memory, which the system clears, costs a fifth of a pair."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

_kept = threading.local()
New = Callable[..., np.ndarray]
# bytes: glibc keeps the memory of smaller arrays once an array of this size has been freed
FREED = 31 * 2**20


def fresh(*shape: int) -> np.ndarray:
    """A new float32 array of undefined content."""
    return np.empty(shape, np.float32)


@contextmanager
def image_buffers(size: tuple[int, ...]) -> Iterator[New]:
    """Yield `new(*shape)`, which returns float32 arrays of undefined content; they are reused after the context ends.

    size: of the images; arrays kept from images of another size are freed. No array may be used after the context.
    """
    if getattr(_kept, "size", None) != size:
        _kept.size, _kept.free = size, {}
        np.empty(FREED, np.uint8)  # freed at once
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
