"""What goes wrong, in one sentence for the user."""

from __future__ import annotations

import difflib
import errno
import os
import re
from collections.abc import Iterable

ADVICE = {
    errno.ENOSPC: "free some of the disk, then run it again: what is finished is kept",
    errno.EDQUOT: "free some of your quota, then run it again: what is finished is kept",
    errno.EROFS: "write elsewhere, or make the folder writable",
    errno.EACCES: "write elsewhere, or make the folder writable",
    errno.EPERM: "write elsewhere, or make the folder writable",
}


def one_line(error: BaseException, longest: int = 80) -> str:
    """The error's text without line breaks and no longer than `longest`; its kind where it has none."""
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    return " ".join(text.split())[:longest] or type(error).__name__


def system_error(error: BaseException) -> int | None:
    """Number of the system's error that an exception carries, or that HDF5 says in its text."""
    if isinstance(error, OSError) and error.errno is not None:
        return error.errno
    named = re.search(r"errno = (\d+)", str(error))
    return int(named.group(1)) if named else None


def sentence(error: BaseException) -> str | None:
    """One sentence for a failure that the machine or the input causes; None for one that is the program's own.

    HDF5 reports a full disk as OSError, RuntimeError or ValueError with the number of the system's error in the text.
    """
    number = system_error(error)
    named = "errno = " in str(error)
    file = error.filename if isinstance(error, OSError) and error.filename else None
    if file is None and (match := re.search(r"name = '([^']*)'", str(error))):
        file = match.group(1)
    if number is not None:
        advice = f"; {ADVICE[number]}" if number in ADVICE else ""
        text = (
            error.strerror
            if isinstance(error, OSError) and error.strerror and not named
            else os.strerror(number)
        )
        return f"{file}: {text}{advice}" if file else f"{text}{advice}"
    if isinstance(error, MemoryError):
        return (
            f"not enough memory ({one_line(error)}); close other programs or work in smaller parts"
        )
    if isinstance(
        error, ValueError | OSError
    ):  # a KeyError that no reader has explained is a defect
        return one_line(error, 2000)
    return None


def nearest(word: str, known: Iterable[str]) -> str | None:
    """The word of `known` that is spelt most alike; None where none is near."""
    return next(iter(difflib.get_close_matches(word, list(known), 1)), None)


def meant(word: str, known: Iterable[str]) -> str:
    """A question that names the nearest of `known`; nothing where none is near."""
    near = nearest(word, known)
    return f"; did you mean {near}?" if near else ""


class StageError(ValueError):
    """A stage cannot go on; the message is one sentence with the cause and the remedy."""
