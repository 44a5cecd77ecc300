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
    content = read_regular(path, _MOST)
    try:
        text = content.decode("utf-8-sig")
        table = tomllib.loads(text)
    except UnicodeDecodeError as error:
        raise StageError(f"{path}: not valid TOML: {one_line(error, 200)}") from None
    except (ValueError, RecursionError) as error:  # of an integer of 4,400 digits too
        if empty := _keys_without_value(text):
            raise StageError(
                f"{path}: no value is given for {', '.join(empty)}; give one, or take the line away"
            ) from None
        raise StageError(f"{path}: not valid TOML: {one_line(error, 200)}") from None
    inner: list[Any] = [table]
    for _ in range(_DEEPEST):
        values = (part.values() if isinstance(part, dict) else part for part in inner)
        inner = [v for found in values for v in found if isinstance(v, dict | list)]
    if inner:
        raise StageError(f"{path}: its tables lie more than {_DEEPEST} deep; no scene's do")
    return table


def _keys_without_value(text: str) -> list[str]:
    """Dotted names of the keys of a TOML text with nothing, or a template's …, after `=`."""
    table, empty = "", []
    for line in text.splitlines():
        if header := re.match(r"\s*\[+\s*([^\]#]+?)\s*\]+", line):
            table = f"{header[1]}."
        elif key := _EMPTY.match(line):
            empty.append(table + key[1])
    return empty
