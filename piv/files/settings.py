"""Settings as dataclasses: by name, and their fields as flags of a subcommand."""

import argparse
from collections.abc import Callable
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from piv.files.errors import suggestion

VECTORS = "vectors: .h5, .nc or another file of piv convert"


def build(settings: dict[str, Any], *kinds: Any, more: tuple[str, ...] = ()) -> list[Any]:
    """One dataclass of each of `kinds`, from its fields in `settings`.

    ValueError for a key that is neither a field nor in `more`, and for a wrong type.
    """
    names = [{field.name for field in fields(kind)} for kind in kinds]
    known = set(more).union(*names)
    if unknown := sorted(set(settings) - known):
        near = suggestion(unknown[0], known) or f"; known are {', '.join(sorted(known))}"
        raise ValueError(f"unknown setting {unknown[0]!r}{near}")
    try:
        return [
            kind(**{key: settings[key] for key in own & settings.keys()})
            for kind, own in zip(kinds, names, strict=True)
        ]
    except TypeError as error:
        raise ValueError(f"a setting has the wrong type: {error}") from error


def positive(text: str) -> float:
    """A positive number of a command line."""
    if not 0 < float(text) < float("inf"):
        raise argparse.ArgumentTypeError(f"must be positive, got {text}")
    return float(text)


def at_least(least: float, kind: Callable[[str], Any] = float) -> Callable[[str], Any]:
    """Reads numbers of a command line that are no less."""

    def number(text: str) -> Any:
        if not kind(text) >= least:
            raise argparse.ArgumentTypeError(f"must be at least {least:g}, got {text}")
        return kind(text)

    return number


def _one_number(kind: Callable[[str], Any], text: str) -> Any:
    """A number of a command line, such as the side of a window."""
    try:
        return kind(text)
    except ValueError:
        way = " (windows and spacings are the same along x and y)" if "x" in text else ""
        raise argparse.ArgumentTypeError(f"give one number{way}, got {text!r}") from None


def add_paths(parser: argparse.ArgumentParser, output: str, source: str = VECTORS) -> None:
    """Arguments source and -o/--output; `output` and `source`: their helps."""
    parser.add_argument("source", type=Path, help=source)
    parser.add_argument("-o", "--output", type=Path, required=True, help=output)


def add_fields(parser: argparse.ArgumentParser, kind: Any) -> None:
    """One flag per field of the dataclass `kind` that has a help; an absent flag sets nothing."""
    hints = get_type_hints(kind, include_extras=True)
    for field in fields(kind):
        if get_origin(hints[field.name]) is not Annotated:
            continue
        value, about = get_args(hints[field.name])
        text = about if field.default is None else f"{about} (default {field.default})"
        options: dict[str, Any] = {"type": next(iter(get_args(value)), value)}
        if options["type"] in (int, float):
            options["type"] = partial(_one_number, options["type"])
        if value is bool:
            options = {"action": argparse.BooleanOptionalAction}
        flag = "--" + field.name.replace("_", "-")
        parser.add_argument(flag, default=argparse.SUPPRESS, help=text, **options)


def run_with(make: Callable[..., None], args: argparse.Namespace) -> None:
    """Call `make(source, output, settings, threads=, quiet=)` with the flags of a command line."""
    settings = {key: value for key, value in vars(args).items() if key != "command"}
    own = {key: settings.pop(key) for key in ("threads", "quiet") if key in settings}
    make(settings.pop("source"), settings.pop("output"), settings, **own)
