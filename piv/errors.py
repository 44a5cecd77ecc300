"""What goes wrong, in one sentence for the user."""

from __future__ import annotations

import errno
import os
import re
import sys

FULL = (errno.ENOSPC, errno.EDQUOT)
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


def disk_full(error: BaseException) -> BaseException | None:
    """The error that said so first, where an error comes from a full disk: closing the file afterwards raises others."""
    found: BaseException | None = None
    at: BaseException | None = error
    while at is not None:
        if system_error(at) in FULL:
            found = at
        at = at.__cause__ or at.__context__
    return found


def end_if_full(error: BaseException, told: str) -> None:
    """Where the disk is full, say so (after `told`, the command's name) and end this process at once with exit code 2.

    Whatever lets the open files go, HDF5's own clean-up as well, crashes on what it cannot write. Locks end with the process.
    """
    full = disk_full(error)
    if full is not None:
        print(f"{told}: {sentence(full)}", file=sys.stderr, flush=True)
        os._exit(2)


def sentence(error: BaseException) -> str | None:
    """One sentence for a failure that the machine or the input causes; None for one that is the program's own.

    HDF5 reports a full disk as OSError, RuntimeError or ValueError with the number of the system's error in the text.
    """
    number = system_error(error)
    named = "errno = " in str(error)
    file = error.filename if isinstance(error, OSError) and error.filename else None
    if file is None and (found := re.search(r"name = '([^']*)'", str(error))):
        file = found.group(1)
    if number is not None:
        advice = f"; {ADVICE[number]}" if number in ADVICE else ""
        text = (
            error.strerror
            if isinstance(error, OSError) and error.strerror and not named
            else os.strerror(number)
        )
        return f"{file}: {text}{advice}" if file else f"{text}{advice}"
    if isinstance(error, MemoryError):
        return f"not enough memory ({one_line(error)}); close other programs or work in smaller parts"
    if isinstance(error, ValueError | OSError | KeyError):
        return one_line(error, 2000)
    return None
