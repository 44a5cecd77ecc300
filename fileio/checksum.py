"""Checksums beside files, `.<name>.sha256`: whether a file is still what its stage wrote.

A stage's outputs get one when it has ended; whoever opens such a file checks it. Files without one, as those of other
programs, pass. `sha256sum -c` reads them too.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

from fileio.atomic import checksum_file, write_text
from fileio.errors import StageError

REMEDY = "delete it and run make again"


def sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_checksums(paths: Iterable[Path]) -> None:
    """Write the checksums of those of `paths` that are files."""
    for path in paths:
        if path.is_file():
            write_text(checksum_file(path), f"{sha256(path)}  {path.name}\n")


def check_whole(path: str | Path, remedy: str = REMEDY) -> None:
    """StageError where a file that has a checksum is not what was written."""
    path = Path(path)
    beside = checksum_file(path)
    if not (beside.is_file() and path.is_file()):
        return
    state = path.stat()
    if (
        _of(path, state.st_mtime_ns, state.st_size, state.st_ino).encode()
        != beside.read_bytes().split(b" ")[0]
    ):
        raise StageError(f"{path}: damaged or changed since it was written (its checksum differs); {remedy}")


@lru_cache(maxsize=256)
def _of(path: Path, *state: int) -> str:
    """The checksum of a file in this state, computed once."""
    return sha256(path)
