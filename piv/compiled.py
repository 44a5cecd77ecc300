"""Numba decorators of all compiled functions: their machine code is kept beside the module.

The first use after an installation compiles them, which takes half a minute; a bar in the terminal
says so.
"""

import sys
from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit
from numba.core import event
from tqdm import tqdm

F = TypeVar("F", bound=Callable[..., Any])
_functions = 0


def _decorator(**options: Any) -> Callable[[F], F]:
    def decorate(function: F) -> F:
        global _functions
        _functions += 1
        return njit(cache=True, nogil=True, **options)(function)

    return decorate


compiled = _decorator()
fast = _decorator(fastmath=True)
inlined = _decorator(fastmath=True, forceinline=True)


class _Bar(event.Listener):
    """A bar while functions compile, one inside the other; in a terminal only."""

    def __init__(self) -> None:
        self.depth = self.done = 0
        self.bar: tqdm | None = None

    def on_start(self, event: event.Event) -> None:
        if self.depth == 0 and sys.stderr.isatty():
            self.bar = tqdm(
                total=max(_functions, self.done + 1),
                initial=self.done,
                desc="compiling, once after the installation",
                unit="function",
                leave=False,
            )
        self.depth += 1

    def on_end(self, event: event.Event) -> None:
        self.depth -= 1
        self.done += 1
        if self.bar is not None:
            self.bar.total = max(self.bar.total, self.done)  # some have several kinds of arrays
            self.bar.update()
            if self.depth == 0:
                self.bar.close()
                self.bar = None


event.register("numba:compile", _Bar())
