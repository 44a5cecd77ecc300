"""Subcommands, errors in one sentence, exit codes 0, 2 (bad input) and 130 (interrupted)."""

import argparse
import io
import os
import resource
import signal
import stat
import sys
from collections.abc import Callable, Mapping
from contextlib import (
    AbstractContextManager,
    nullcontext,
    redirect_stderr,
    redirect_stdout,
    suppress,
)
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from piv.files import __version__
from piv.files.errors import (
    FLAGS,
    StageError,
    printable,
    sentence,
    suggestion,
    system_error,
    warn,
)

_PROGRAMS = ("softfinger", "piv")
_LEAST_MEMORY = 2 * 10**9  # bytes of address space; the libraries alone reserve about one
_INTERRUPTED = "interrupted; run it again to go on: what is finished is kept"


def _exit_at_interrupt(*_: object) -> None:
    os.write(2, f"{_INTERRUPTED}\n".encode())
    os._exit(130)


def _open_streams() -> None:
    """Give a closed standard stream the null device: the next file would take its number."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115


def _check_memory() -> None:
    """End in a sentence where the shell's limit is too low: libraries would interrupt, or crash."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit not in (resource.RLIM_INFINITY, -1) and limit < _LEAST_MEMORY:
        os.write(2, b"not enough memory: ulimit -v gives %d MB; give at least %d\n"
                 % (limit // 10**6, _LEAST_MEMORY // 10**6))  # fmt: skip
        os._exit(2)


def importing() -> None:
    """Make Ctrl-C exit at once until `working`: libraries raise other errors during imports.

    A process that ignores the signal, such as a background job, still ignores it.
    """
    _open_streams()
    _check_memory()
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _exit_at_interrupt)


def working() -> None:
    """Make Ctrl-C raise KeyboardInterrupt again, so that open work is cleaned up."""
    if signal.getsignal(signal.SIGINT) is _exit_at_interrupt:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _is_interrupt(error: BaseException | None) -> bool:
    """Whether an error is a KeyboardInterrupt or was caused by one."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


_SPEC = getattr(sys.modules["__main__"], "__spec__", None)
if getattr(_SPEC, "name", "").partition(".")[0] in _PROGRAMS:
    importing()  # `python -m` imports the rest of the program next


def guarded(name: str, action: Callable[[], int | None], strict: bool = False) -> int:
    """Exit code of `action`; prints a foreseeable error as one sentence that begins with `name`.

    `strict`: a ValueError that is neither a StageError nor a system error is a defect and raised.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a console that has no × prints ?
            stream.reconfigure(errors="replace")
    with redirect_stdout(_Terminal(sys.stdout)), redirect_stderr(_Terminal(sys.stderr, "\r")):
        return _ended(name, action, strict)


class _Terminal:
    """A stream on which texts of files and names steer no terminal; `kept`: of progress bars."""

    def __init__(self, stream: Any, kept: str = "\n") -> None:
        self._stream, self._kept = stream, kept
        self.rich_proxied_file = stream  # to which rich writes the help, with its colours

    def write(self, text: str) -> int:
        return self._stream.write(self._kept.join(map(printable, text.split(self._kept))))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def _ended(name: str, action: Callable[[], int | None], strict: bool) -> int:
    begin = f"{name}: " if name else ""
    try:
        return action() or 0
    except (KeyboardInterrupt, Exception) as error:
        if _is_interrupt(error):
            print(f"{begin}{_INTERRUPTED}", file=sys.stderr)
            return 130
        defect = strict and isinstance(error, ValueError) and not isinstance(error, StageError)
        message = None if defect and system_error(error) is None else sentence(error)
        if message is None:
            raise
        warn(f"{begin}{message}")
        return 2


def _check_inputs(args: argparse.Namespace) -> None:
    """StageError where an argument names a pipe or a device."""
    values = [
        v
        for value in vars(args).values()
        for v in (value if isinstance(value, list | tuple) else [value])
    ]
    for path in (Path(value) for value in values if isinstance(value, str | Path)):
        with suppress(OSError, ValueError):  # not a path
            kind = path.stat().st_mode
            if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):
                break
    else:
        return
    raise StageError(f"{path}: is neither a file nor a folder; give another name")


class _Parser(argparse.ArgumentParser):
    """A parser that reports an error in one sentence, without its usage."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (--help lists what may be given)\n")


def command_line(
    program: str,
    doc: str | None,
    commands: Mapping[str, tuple[str, Any]],
    argv: list[str] | None = None,
    around: Callable[[argparse.Namespace], AbstractContextManager[Any]] = nullcontext,
) -> int:
    """Run the subcommand in `argv` within `around(args)`; returns the exit code.

    commands: by name, a description and the module (or its name) with `run(args)` and, for
    arguments, `add_arguments(parser)`; all have --quiet. Only the chosen module is imported.
    """
    parser = _Parser(prog=program, description=doc)
    parser.add_argument("--version", action="version", version=f"{program} {__version__}")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="command")
    words = sys.argv[1:] if argv is None else argv
    if argv is None:
        importing()

    def action() -> int | None:
        module: Any = None
        chosen = parser
        if words and not words[0].startswith("-") and words[0] not in commands:
            parser.error(f"{words[0]}: no such command{suggestion(words[0], commands)}")
        for name, (about, where) in commands.items():
            sub = subparsers.add_parser(name, help=about, description=about)
            if words and words[0] == name:
                chosen = sub
                module = import_module(where) if isinstance(where, str) else where
                if hasattr(module, "add_arguments"):
                    module.add_arguments(sub)
                sub.add_argument("--quiet", action="store_true", help="print nothing but errors")
        args, unknown = parser.parse_known_args(words)
        if unknown:
            options = suggestion(unknown[0], chosen._option_string_actions)
            chosen.error(f"unrecognized arguments: {' '.join(unknown)}{options}")
        _check_inputs(args)
        working()
        for option in chosen._actions:
            flags = [flag for flag in option.option_strings if flag.startswith("--")]
            if flags:
                FLAGS[option.dest] = flags[0]
        with around(args):
            return module.run(args)

    try:
        return guarded(" ".join([program, *words[:1]]), action)
    finally:
        FLAGS.clear()
