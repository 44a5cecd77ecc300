"""Failures as one sentence for the user."""

import difflib
import errno
import os
import re
import sys
from collections.abc import Iterable

_ADVICE = {
    errno.ENOSPC: "free some of the disk, then run it again: what is finished is kept",
    errno.EDQUOT: "free some of your quota, then run it again: what is finished is kept",
} | dict.fromkeys(
    (errno.EROFS, errno.EACCES, errno.EPERM), "write elsewhere, or make the folder writable"
)

# control characters, which begin escape sequences, and those that turn the direction of writing
_STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


# of the command that runs: its options by name, such as interval: --interval; empty in Python
FLAGS: dict[str, str] = {}


def as_flags(text: str) -> str:
    """The text with the options in it, `interval` or `shake = False`, as flags of the command."""

    def flag(match: re.Match[str]) -> str:
        name, value = match.groups()
        if name not in FLAGS:
            return match[0]
        word = FLAGS[name]
        if value in ("True", "False"):
            return word if value == "True" else f"--no-{word[2:]}"
        return f"{word} {value}" if value else word

    return re.sub(r"`(\w+)(?: = ([^`]+))?`", flag, text)


def warn(text: str) -> None:
    """Print a warning or an error to stderr; options in it as `as_flags`."""
    print(printable(as_flags(text)), file=sys.stderr, flush=True)


def one_line(error: BaseException, longest: int = 80) -> str:
    """The error's text on one line, cut to `longest` characters; without a text its kind."""
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    return " ".join(text.split())[:longest] or type(error).__name__


def printable(text: str) -> str:
    """The text with � for each character that would steer a terminal, but tabs and new lines."""
    return _STEERING.sub("\ufffd", text)


def system_error(error: BaseException) -> int | None:
    """The system's error number of an exception, or in the text of one of HDF5."""
    if isinstance(error, OSError) and error.errno is not None:
        return error.errno
    named = re.search(r"errno = (\d+)", str(error))
    return int(named.group(1)) if named else None


def sentence(error: BaseException) -> str | None:
    """One sentence for a failure by the machine or the input; None for a defect of the program.

    HDF5 reports a full disk as OSError, RuntimeError or ValueError with the system's error number
    in the text.
    """
    number = system_error(error)
    if number is not None:
        own = None if "errno = " in str(error) else getattr(error, "strerror", None)
        text = own or os.strerror(number)
        match = re.search(r"name = '([^']*)'", str(error))
        file = getattr(error, "filename", None) or (match and match.group(1))
        advice = f"; {_ADVICE[number]}" if number in _ADVICE else ""
        return f"{file}: {text}{advice}" if file else f"{text}{advice}"
    if isinstance(error, MemoryError):
        cure = "close other programs or work in smaller parts"
        return f"not enough memory ({one_line(error)}); {cure}"
    # a KeyError that no reader has explained is a defect
    return one_line(error, 2000) if isinstance(error, ValueError | OSError) else None


def suggestion(word: str, known: Iterable[str]) -> str:
    """Text that suggests the nearest word of `known`; empty where none is near."""
    near = difflib.get_close_matches(word, list(known), 1)
    return f"; did you mean {near[0]}?" if near else ""


class StageError(ValueError):
    """A stage cannot go on; the message is one sentence with the cause and the remedy."""
