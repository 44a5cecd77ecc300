"""Settings of a subcommand: defaults, then the JSON file of --settings, then the flags."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from fileio.formats.plane_series import read_plane
from fileio.json_text import read_json
from piv.fields.summary import summary


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add --settings and --quiet."""
    parser.add_argument(
        "--settings", metavar="FILE", help="JSON with the same keys as the flags; flags win"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress bar")


def add_fields(parser: argparse.ArgumentParser, kind: Any) -> None:
    """One flag per field of the dataclass `kind` that is annotated with a help; absent flags leave no trace."""
    hints = get_type_hints(kind, include_extras=True)
    for field in fields(kind):
        if get_origin(hints[field.name]) is not Annotated:
            continue
        value, about = get_args(hints[field.name])
        text = about if field.default is None else f"{about} (default {field.default})"
        options: dict[str, Any] = {"type": next(iter(get_args(value)), value)}
        if value is bool:
            options = {"action": argparse.BooleanOptionalAction}
        flag = "--" + field.name.replace("_", "-")
        parser.add_argument(flag, default=argparse.SUPPRESS, help=text, **options)


def merged(args: argparse.Namespace, known: set[str]) -> dict[str, Any]:
    """The `known` settings given in the file of --settings or as flags; ValueError for unknown keys in the file."""
    given: dict[str, Any] = {}
    if getattr(args, "settings", None):
        path = existing(args.settings)
        given = read_json(path, "settings are one JSON object of keys and values")
        given = {key.replace("-", "_"): value for key, value in given.items()}
        unknown = sorted(set(given) - known)
        if unknown:
            raise ValueError(
                f"{path}: unknown setting {unknown[0]!r}; known are {', '.join(sorted(known))}"
            )
    return given | {key: value for key, value in vars(args).items() if key in known}


def build(kind: Any, given: dict[str, Any]) -> Any:
    """A dataclass `kind` from those of the `given` settings that are its fields."""
    names = {field.name for field in fields(kind)}
    try:
        return kind(**{key: value for key, value in given.items() if key in names})
    except TypeError as error:
        raise ValueError(f"a setting has the wrong type: {error}") from error


def report(path: str | Path) -> None:
    """Print what a file of vectors holds."""
    with read_plane(path) as plane:
        print(f"{path}: {summary(plane)}")


def existing(path: str) -> Path:
    """`path` as a Path; FileNotFoundError with one sentence where there is no such file."""
    if not Path(path).is_file():
        raise FileNotFoundError(
            f"{path}: {'is a folder; give a file' if Path(path).is_dir() else 'no such file'}"
        )
    return Path(path)
