"""Command lines: subcommands by name, failures as one sentence, exit codes 0, 2 (bad input) and 130 (interrupted)."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
from pathlib import Path
from typing import Any

from fileio import __version__
from fileio.errors import StageError, sentence, system_error

# name: what it does, and where `run(args)` and, where it takes arguments, `add_arguments(parser)` are: a module or an object
Commands = Mapping[str, tuple[str, Any]]


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Arguments of every command that works on a scene at one level."""
    parser.add_argument("scene", type=Path, help="folder of the scene, as cases/single_finger")
    parser.add_argument("--level", default="coarse", help="level of the scene (default: %(default)s)")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def guarded(name: str, action: Callable[[], int | None], strict: bool = False) -> int:
    """Exit code of `action`; a foreseeable failure becomes one sentence that begins with `name`.

    `strict`: a ValueError that is neither a StageError nor the system's is a defect, with its traceback.
    """
    try:
        return action() or 0
    except KeyboardInterrupt:
        print(f"{name}: interrupted; run it again to go on: what is finished is kept", file=sys.stderr)
        return 130
    except Exception as error:
        defect = strict and isinstance(error, ValueError) and not isinstance(error, StageError)
        message = None if defect and system_error(error) is None else sentence(error)
        if message is None:
            raise
        print(f"{name}: {message}", file=sys.stderr)
        return 2


def command_line(
    program: str,
    doc: str | None,
    commands: Commands,
    argv: list[str] | None = None,
    around: Callable[[argparse.Namespace], AbstractContextManager[Any]] = lambda args: nullcontext(),
    prefix: str = "",
    strict: bool = False,
) -> int:
    """Run the subcommand that is asked for, within `around(args)`; returns the exit code.

    Only that one's module is imported: the others' libraries are slow to load.
    """
    parser = argparse.ArgumentParser(prog=program, description=doc)
    parser.add_argument("--version", action="version", version=f"{program} {__version__}")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="command")
    given = sys.argv[1:] if argv is None else argv

    def action() -> int | None:
        found: Any = None
        for name, (about, where) in commands.items():
            sub = subparsers.add_parser(name, help=about, description=about)
            if given and given[0] == name:
                found = import_module(where) if isinstance(where, str) else where
                if hasattr(found, "add_arguments"):
                    found.add_arguments(sub)
        args = parser.parse_args(given)
        with around(args):
            return found.run(args)

    return guarded(prefix + (given[0] if given else ""), action, strict)
