"""Checksums beside files, `.<name>.sha256`: whether a file is still what its stage wrote.

A stage's outputs get one with their names (fileio.atomic); whoever opens such a file checks it. Files without one, as
those of other programs, pass. `sha256sum -c` reads them too.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from fileio.atomic import checksum_file, sha256
from fileio.errors import StageError

REMEDY = "delete it and run make again"


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
        raise StageError(
            f"{path}: damaged or changed since it was written (its checksum differs); {remedy}"
        )


@lru_cache(maxsize=256)
def _of(path: Path, *state: int) -> str:
    """The checksum of a file in this state, computed once."""
    return sha256(path)
