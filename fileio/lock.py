"""One writer at a time of a file or folder, by a lock that the kernel gives back however its holder ends."""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def exclusive(target: Path, *, wait: bool = False) -> Iterator[None]:
    """Hold the lock on `target`, the hidden file `.<name>.lock` beside it, which is removed afterwards.

    Where another process holds it: BlockingIOError, or with `wait` its end is waited for. FileNotFoundError where there is no folder for it.
    """
    if not target.parent.is_dir():
        raise FileNotFoundError(
            errno.ENOENT, "its folder does not exist; make it first", str(target)
        )
    path = target.with_name(f".{target.name}.lock")
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError:
            os.close(descriptor)
            raise BlockingIOError(
                errno.EWOULDBLOCK,
                "another make or command is writing it; wait for it or stop it",
                str(target),
            ) from None
        try:  # its last holder may have removed it between our opening and locking it
            if os.path.samestat(os.fstat(descriptor), os.stat(path)):
                break
        except FileNotFoundError:
            pass
        os.close(descriptor)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(descriptor)
