"""Settings of a subcommand: defaults, then the JSON file of --settings, then the flags."""

from __future__ import annotations

import argparse
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from fileio.json_text import read_json


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add --settings and --quiet."""
    parser.add_argument("--settings", metavar="FILE", help="JSON with the same keys as the flags; flags win")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")


def add_fields(parser: argparse.ArgumentParser, kind: Any, helps: dict[str, str]) -> None:
    """One flag per field of the dataclass `kind` that `helps` explains; absent flags leave no trace in the namespace."""
    for field in fields(kind):
        if field.name not in helps:
            continue
        default = None if field.default is MISSING else field.default
        flag = "--" + field.name.replace("_", "-")
        text = f"{helps[field.name]} (default {'automatic' if default is None else default})"
        if isinstance(default, bool):
            parser.add_argument(
                flag, action=argparse.BooleanOptionalAction, default=argparse.SUPPRESS, help=text
            )
        else:
            parser.add_argument(
                flag, type=float if default is None else type(default), default=argparse.SUPPRESS, help=text
            )


def merged(args: argparse.Namespace, known: set[str]) -> dict[str, Any]:
    """The `known` settings given in the file of --settings or as flags; ValueError for unknown keys in the file."""
    given: dict[str, Any] = {}
    if getattr(args, "settings", None):
        path = existing(args.settings)
        given = read_json(path, "settings are one JSON object of keys and values")
        given = {key.replace("-", "_"): value for key, value in given.items()}
        unknown = sorted(set(given) - known)
        if unknown:
            raise ValueError(f"{path}: unknown setting {unknown[0]!r}; known are {', '.join(sorted(known))}")
    return given | {key: value for key, value in vars(args).items() if key in known}


def build(kind: Any, given: dict[str, Any]) -> Any:
    """A dataclass `kind` from those of the `given` settings that are its fields."""
    names = {field.name for field in fields(kind)}
    try:
        return kind(**{key: value for key, value in given.items() if key in names})
    except TypeError as error:
        raise ValueError(f"a setting has the wrong type: {error}") from error


def existing(path: str) -> Path:
    """`path` as a Path; FileNotFoundError with one sentence where there is no such file."""
    if not Path(path).is_file():
        raise FileNotFoundError(f"{path}: no such file")
    return Path(path)
