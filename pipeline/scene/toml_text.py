"""Reader of TOML files; its errors name the keys without a value."""

import re
import tomllib
from pathlib import Path
from typing import Any

from piv.files.errors import StageError, one_line

_EMPTY = re.compile(r"\s*([\w.\"'-]+)\s*=\s*(…|\.\.\.|)\s*(#.*)?$")  # … stands in templates


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a file; StageError where it is no TOML."""
    try:
        text = path.read_text(encoding="utf-8")
        return tomllib.loads(text)
    except UnicodeDecodeError as error:
        raise StageError(f"{path}: not valid TOML: {one_line(error, 200)}") from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        if empty := _keys_without_value(text):
            raise StageError(
                f"{path}: no value is given for {', '.join(empty)}; give one, or take the line away"
            ) from None
        raise StageError(f"{path}: not valid TOML: {one_line(error, 200)}") from None


def _keys_without_value(text: str) -> list[str]:
    """Dotted names of the keys of a TOML text with nothing, or a template's …, after `=`."""
    table, empty = "", []
    for line in text.splitlines():
        if header := re.match(r"\s*\[+\s*([^\]#]+?)\s*\]+", line):
            table = f"{header[1]}."
        elif key := _EMPTY.match(line):
            empty.append(table + key[1])
    return empty
