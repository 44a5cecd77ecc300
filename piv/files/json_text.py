"""JSON files and HDF5 attributes that must hold an object."""

import json
import re
from datetime import date
from pathlib import Path
from typing import Any

from piv.files.errors import StageError
from piv.files.record import check_whole


def parse_json(text: str | bytes, place: str | Path, remedy: str) -> dict[str, Any]:
    """The object that `text` is; StageError with `place`, fault and `remedy`."""
    try:
        value = json.loads(text)
    except (TypeError, ValueError, RecursionError) as error:
        raise StageError(f"{place}: not valid JSON ({error}); {remedy}") from error
    if not isinstance(value, dict):
        raise StageError(f"{place}: holds a {type(value).__name__}, not an object; {remedy}")
    return value


def plain(value: Any) -> Any:
    """NumPy numbers and arrays, dates and paths as values of JSON; TypeError for others."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Path | date):
        return str(value)
    raise TypeError(f"{value!r} is no value of JSON")


def flat(table: dict[str, Any], above: str = "") -> dict[str, Any]:
    """The values of a table and of the tables in it, by their keys joined with dots."""
    values: dict[str, Any] = {}
    for key, value in table.items():
        name = f"{above}{key}"
        values |= flat(value, f"{name}.") if isinstance(value, dict) else {name: value}
    return values


def read_json(path: Path, remedy: str) -> dict[str, Any]:
    """The object in a file; StageError as of `parse_json`."""
    check_whole(path)
    return parse_json(path.read_bytes(), path, remedy)


def natural_key(path: str | Path) -> list[tuple[int, int | str]]:
    """Sort key in which numbers inside names count as numbers."""
    parts = re.split(r"(\d+)", str(path))
    return [(1, int(p)) if p.isdecimal() else (0, p.lower()) for p in parts]
