"""Command lines: subcommands by name, failures as one sentence, exit codes 0, 2 (bad input) and 130 (interrupted)."""

from __future__ import annotations

import argparse
import io
import stat
import sys
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Any

from fileio import __version__
from fileio.errors import StageError, sentence, system_error

# name: what it does, and where `run(args)` and, where it takes arguments, `add_arguments(parser)` are: a module or an object
Commands = Mapping[str, tuple[str, Any]]

INTERRUPTED = "interrupted; run it again to go on: what is finished is kept"


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Arguments of every command that works on a scene at one level."""
    parser.add_argument("scene", type=Path, help="folder of the scene, as cases/single_finger")
    parser.add_argument("--level", default="coarse", help="level of the scene (default: %(default)s)")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def interrupted(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """The hook for exceptions that nobody caught: Ctrl-C during the first imports is one sentence too."""
    if issubclass(kind, KeyboardInterrupt):
        print(INTERRUPTED, file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


sys.excepthook = interrupted


def guarded(name: str, action: Callable[[], int | None], strict: bool = False) -> int:
    """Exit code of `action`; a foreseeable failure becomes one sentence that begins with `name`.

    `strict`: a ValueError that is neither a StageError nor the system's is a defect, with its traceback.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a console that has no × prints ?
            stream.reconfigure(errors="replace")
    try:
        return action() or 0
    except KeyboardInterrupt:
        print(f"{name}: {INTERRUPTED}", file=sys.stderr)
        return 130
    except Exception as error:
        defect = strict and isinstance(error, ValueError) and not isinstance(error, StageError)
        message = None if defect and system_error(error) is None else sentence(error)
        if message is None:
            raise
        print(f"{name}: {message}", file=sys.stderr)
        return 2


def check_inputs(args: argparse.Namespace) -> None:
    """StageError where an argument names a pipe or a device: who reads it may wait for ever, who writes it replaces it."""
    values = [
        v for value in vars(args).values() for v in (value if isinstance(value, list | tuple) else [value])
    ]
    for path in (Path(value) for value in values if isinstance(value, str | Path)):
        with suppress(OSError, ValueError):  # no path at all
            kind = path.stat().st_mode
            if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):
                break
    else:
        return
    raise StageError(f"{path}: is neither a file nor a folder; give another name")


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
        module: Any = None
        for name, (about, where) in commands.items():
            sub = subparsers.add_parser(name, help=about, description=about)
            if given and given[0] == name:
                module = import_module(where) if isinstance(where, str) else where
                if hasattr(module, "add_arguments"):
                    module.add_arguments(sub)
        args = parser.parse_args(given)
        check_inputs(args)
        with around(args):
            return module.run(args)

    return guarded(prefix + (given[0] if given else ""), action, strict)
