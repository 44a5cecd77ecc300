"""One run at a time: a lock that the kernel gives back however its holder ends."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import StageError

LOCK = ".lock"


@contextmanager
def only_one(folder: Path) -> Iterator[None]:
    """Hold the lock on `folder`; StageError where there is no such folder, or another run holds it."""
    if not folder.is_dir():
        raise StageError(f"{folder}: no case; run the case stage first")
    with open(folder / LOCK, "w", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise StageError(f"{folder}: another run is at work here; wait for it or stop it") from None
        yield
