"""Files that are there whole or not at all, whatever fails while they are written: the process, the disk, the power."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fileio.errors import StageError

ROOM = 2**16  # bytes; a disk that has less is full


@contextmanager
def naming(path: str | Path, *aliases: str) -> Iterator[None]:
    """Let an OSError tell of `path` where it names no file, as that of a write, or one of `aliases`."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename not in (None, *aliases):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


def settle(path: Path) -> None:
    """Return when the file's content is on the disk. OSError where the disk refuses it only now."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def check_output(path: Path) -> None:
    """StageError where `path` is a folder or a device: a file of that name would take its place."""
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
    """Yield the name of a file beside `path` to be written, which becomes `path` where the block ends well, else is removed.

    Its folder is made. `suffix`: the name ends as that of `path` does, for writers that go by it. `sync`: on the disk first; without it a
    power cut may leave an empty file. An OSError names `path`.
    """
    path = Path(path)
    check_output(path)
    part = path.with_name(f"{path.stem}.part{path.suffix}" if suffix else f"{path.name}.part")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with naming(path, str(part)):
            yield part
            if sync:
                settle(part)
            os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def write_bytes(path: str | Path, content: bytes | memoryview, *, sync: bool = True) -> None:
    """Write a file whole or not at all; its folder is made. `sync` as in `whole`."""
    with whole(path, sync=sync) as part:
        part.write_bytes(content)


def write_text(path: str | Path, text: str) -> None:
    """Write a text (UTF-8) whole or not at all; its folder is made."""
    write_bytes(path, text.encode())


def update_text(path: Path, text: str) -> None:
    """`write_text` where the file is missing or says otherwise."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        write_text(path, text)


def check_room(folder: Path) -> None:
    """OSError where `folder` has no room left for a small file: programs of others fail of it without saying so."""
    path = folder / ".room"
    try:
        write_bytes(path, bytes(ROOM))
    finally:
        path.unlink(missing_ok=True)
