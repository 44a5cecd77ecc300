"""Atomic writes: a file is complete or absent, whatever fails during the write."""

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from piv.files.errors import StageError

_ROOM = 2**16  # bytes; a disk with less free space counts as full


@contextmanager
def name_in_errors(path: str | Path, *aliases: str) -> Iterator[None]:
    """Name `path` in an OSError that names no file, or one of `aliases`."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename not in (None, *aliases):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


def sync_file(path: Path) -> None:
    """Wait until the file's content is on the disk; OSError where the disk refuses it."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def check_output(path: Path) -> None:
    """StageError where `path` is a folder or a device, which a rename would replace."""
    if path.exists() and not path.is_file():
        raise StageError(
            f"{path}: is no file but a folder or a device; give the output another name"
        )


def sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def whole(path: str | Path, *, suffix: bool = False, sync: bool = True) -> Iterator[Path]:
    """Yield a temporary name, renamed to `path` if the block succeeds, else removed.

    Makes the folder. `suffix`: the temporary name keeps the extension of `path`, which some
    writers need. `sync`: flush to the disk before the rename; without it a power cut may leave an
    empty file. An OSError names `path`.
    """
    path = Path(path)
    check_output(path)
    part = path.with_name(f"{path.stem}.part{path.suffix}" if suffix else f"{path.name}.part")
    path.parent.mkdir(parents=True, exist_ok=True)
    part.unlink(missing_ok=True)  # of a killed run, or a link: its target stays as it is
    try:
        with name_in_errors(path, str(part)):
            yield part
            if sync:
                sync_file(part)
            os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def write_bytes(path: str | Path, content: bytes | memoryview, *, sync: bool = True) -> None:
    """Write a file atomically; `sync` as in `whole`."""
    with whole(path, sync=sync) as part:
        part.write_bytes(content)


def write_text(path: str | Path, text: str) -> None:
    """Write a UTF-8 text atomically."""
    write_bytes(path, text.encode())


def check_room(folder: Path) -> None:
    """OSError where the disk of `folder` is full, which other programs do not report."""
    path = folder / ".room"
    try:
        write_bytes(path, bytes(_ROOM))
    finally:
        path.unlink(missing_ok=True)
