"""Contents of files that others wrote: regular files of a limited size alone."""

import stat
from pathlib import Path

from piv.files.errors import StageError

MOST = 64 * 2**20  # bytes of a text, table or JSON file; the largest of this project have 2 MB


def read_regular(path: Path, most: int = MOST) -> bytes:
    """The bytes of a file; StageError where it is a pipe or device, or exceeds `most` bytes."""
    state = path.stat()
    if not stat.S_ISREG(state.st_mode):
        raise StageError(f"{path}: is not a regular file; give one")
    if state.st_size > most:
        raise StageError(
            f"{path}: has {state.st_size / 1e6:.0f} MB; at most {most / 1e6:.0f} MB are read"
        )
    with path.open("rb") as file:
        return file.read(most)  # also of a file that grows, or states no size
