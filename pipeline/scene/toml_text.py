"""Reader of TOML files; its errors name the keys without a value."""

import re
import tomllib
from pathlib import Path
from typing import Any

from piv.files.errors import StageError, one_line
from piv.files.regular import read_regular

_MOST = 2**20  # bytes; the longest scene.toml has 20 thousand
_DEEPEST = 32
_EMPTY = re.compile(r"\s*([\w.\"'-]+)\s*=\s*(…|\.\.\.|)\s*(#.*)?$")  # … stands in templates


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a file; StageError where it is no TOML."""
    tables, empty = read_template(path)
    if empty:
        raise StageError(
            f"{path}: no value is given for {', '.join(empty)}; give one, or take the line away"
        )
    return tables


def read_template(path: Path) -> tuple[dict[str, Any], list[str]]:
    """The tables of a file, and the dotted names of its keys that have no value yet."""
    content, empty = read_regular(path, _MOST), list[str]()
    try:
        text = content.decode("utf-8-sig")
        try:
            table = tomllib.loads(text)
        except tomllib.TOMLDecodeError:
            if not (empty := _keys_without_value(text)):
                raise
            lines = [line for line in text.splitlines() if not _EMPTY.match(line)]
            table = tomllib.loads("\n".join(lines))
    except (ValueError, RecursionError) as error:  # of an integer of 4,400 digits too
        why = one_line(error, 200).partition("; use sys.")[0]  # advice for programmers
        raise StageError(f"{path}: not valid TOML: {why}") from None
    inner: list[Any] = [table]
    for _ in range(_DEEPEST):
        values = (part.values() if isinstance(part, dict) else part for part in inner)
        inner = [v for found in values for v in found if isinstance(v, dict | list)]
    if inner:
        raise StageError(f"{path}: its tables lie more than {_DEEPEST} deep; no scene's do")
    return table, empty


def _keys_without_value(text: str) -> list[str]:
    """Dotted names of the keys of a TOML text with nothing, or a template's …, after `=`."""
    table, empty = "", []
    for line in text.splitlines():
        if header := re.match(r"\s*\[+\s*([^\]#]+?)\s*\]+", line):
            table = f"{header[1]}."
        elif key := _EMPTY.match(line):
            empty.append(table + key[1])
    return empty
