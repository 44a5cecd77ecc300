"""File locks, which the kernel releases however the holder ends."""

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def exclusive(target: Path) -> Iterator[None]:
    """Lock `target` by the hidden file `.<name>.lock` beside it, which is removed afterwards.

    BlockingIOError where another process holds the lock, FileNotFoundError where the folder of
    `target` is missing.
    """
    if not target.parent.is_dir():
        raise FileNotFoundError(
            errno.ENOENT, "its folder does not exist; make it first", str(target)
        )
    path = target.with_name(f".{target.name}.lock")
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(descriptor)
            raise BlockingIOError(
                errno.EWOULDBLOCK,
                "another make or command is writing it; wait for it or stop it",
                str(target),
            ) from None
        try:  # the last holder may have removed the file before it was locked here
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
