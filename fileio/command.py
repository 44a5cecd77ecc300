"""Command lines: subcommands by name, failures as one sentence, exit codes 0, 2 (bad input) and 130 (interrupted)."""

from __future__ import annotations

import argparse
import io
import os
import signal
import stat
import sys
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from fileio import __version__
from fileio.errors import StageError, meant, sentence, system_error

# name: what it does, and where `run(args)` and, where it takes arguments, `add_arguments(parser)` are: a module or an object
Commands = Mapping[str, tuple[str, Any]]

PROGRAMS = ("pipeline", "piv", "postprocess")
DEFAULT_LEVEL = "coarse"
INTERRUPTED = "interrupted; run it again to go on: what is finished is kept"


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Arguments of every command that works on a scene at one level."""
    parser.add_argument("scene", type=Path, help="folder of the scene, as cases/single_finger")
    parser.add_argument(
        "--level", default=DEFAULT_LEVEL, help="level of the scene (default: %(default)s)"
    )
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def end_at_once(*_: object) -> None:
    """Ctrl-C while modules are imported: libraries would make errors of their own of it, and nothing is begun yet."""
    os.write(2, f"{INTERRUPTED}\n".encode())
    os._exit(130)


def importing() -> None:
    """Let Ctrl-C end this program at once until `working`; one that ignores it, as a job in the background, still does."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, end_at_once)


def working() -> None:
    """Let Ctrl-C be KeyboardInterrupt again: what is begun is tidied up."""
    if signal.getsignal(signal.SIGINT) is end_at_once:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def ends_in_interrupt(error: BaseException | None) -> bool:
    """Whether an error is what a library has made of Ctrl-C."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


if (
    getattr(getattr(sys.modules["__main__"], "__spec__", None), "name", "").partition(".")[0]
    in PROGRAMS
):
    importing()  # the rest of what `python -m` of one of them needs


def guarded(name: str, action: Callable[[], int | None], strict: bool = False) -> int:
    """Exit code of `action`; a foreseeable failure becomes one sentence that begins with `name`.

    `strict`: a ValueError that is neither a StageError nor the system's is a defect, with its traceback.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a console that has no × prints ?
            stream.reconfigure(errors="replace")
    begin = f"{name}: " if name else ""
    try:
        return action() or 0
    except KeyboardInterrupt:
        print(f"{begin}{INTERRUPTED}", file=sys.stderr)
        return 130
    except Exception as error:
        if ends_in_interrupt(error):
            print(f"{begin}{INTERRUPTED}", file=sys.stderr)
            return 130
        defect = strict and isinstance(error, ValueError) and not isinstance(error, StageError)
        message = None if defect and system_error(error) is None else sentence(error)
        if message is None:
            raise
        print(f"{begin}{message}", file=sys.stderr)
        return 2


def check_inputs(args: argparse.Namespace) -> None:
    """StageError where an argument names a pipe or a device: who reads it may wait for ever, who writes it replaces it."""
    values = [
        v
        for value in vars(args).values()
        for v in (value if isinstance(value, list | tuple) else [value])
    ]
    for path in (Path(value) for value in values if isinstance(value, str | Path)):
        with suppress(OSError, ValueError):  # no path at all
            kind = path.stat().st_mode
            if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):
                break
    else:
        return
    raise StageError(f"{path}: is neither a file nor a folder; give another name")


class Parser(argparse.ArgumentParser):
    """A parser whose complaints are one sentence, without its usage."""

    def error(self, message: str) -> NoReturn:
        """End with the exit code of bad input."""
        self.exit(2, f"{self.prog}: {message} (--help lists what may be given)\n")


def command_line(
    program: str,
    doc: str | None,
    commands: Commands,
    argv: list[str] | None = None,
    around: Callable[[argparse.Namespace], AbstractContextManager[Any]] = lambda args: (
        nullcontext()
    ),
    prefix: str = "",
    strict: bool = False,
) -> int:
    """Run the subcommand that is asked for, within `around(args)`; returns the exit code.

    Only that one's module is imported: the others' libraries are slow to load.
    """
    parser = Parser(prog=program, description=doc)
    parser.add_argument("--version", action="version", version=f"{program} {__version__}")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="command")
    given = sys.argv[1:] if argv is None else argv
    if argv is None:
        importing()

    def action() -> int | None:
        module: Any = None
        chosen = parser
        if given and not given[0].startswith("-") and given[0] not in commands:
            parser.error(f"{given[0]}: no such command{meant(given[0], commands)}")
        for name, (about, where) in commands.items():
            sub = subparsers.add_parser(name, help=about, description=about)
            if given and given[0] == name:
                chosen = sub
                module = import_module(where) if isinstance(where, str) else where
                if hasattr(module, "add_arguments"):
                    module.add_arguments(sub)
        args, unknown = parser.parse_known_args(given)
        if unknown:
            options = meant(unknown[0], chosen._option_string_actions)
            chosen.error(f"unrecognized arguments: {' '.join(unknown)}{options}")
        check_inputs(args)
        working()
        with around(args):
            return module.run(args)

    return guarded(prefix + (given[0] if given else ""), action, strict)
