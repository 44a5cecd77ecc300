"""The command line that the stages of this package share: scene, level, one-sentence errors, cost record."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import TypeVar

from fileio.cost import cost_recorded
from fileio.errors import sentence
from fileio.lock import exclusive
from postprocess.evidence.stage_files import StageFiles

Result = TypeVar("Result")


def run_stage(
    stage: str,
    doc: str | None,
    action: Callable[[StageFiles], Result],
    print_result: Callable[[StageFiles, Result], None],
    argv: list[str] | None = None,
) -> int:
    """Run `action` on the scene and level of the arguments, then `print_result` unless --quiet; 0 good, 2 bad input."""
    parser = argparse.ArgumentParser(prog=f"python -m postprocess.{stage}", description=doc)
    parser.add_argument("case", type=Path, help="folder of the scene, such as cases/single_finger")
    parser.add_argument("--level", default="coarse")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    args = parser.parse_args(argv)
    files = StageFiles(args.case, args.level)
    try:
        with (
            exclusive(files.out / stage) if files.out.is_dir() else nullcontext(),
            cost_recorded(files.out, stage),
        ):
            result = action(files)
    except Exception as error:
        message = sentence(error)
        if message is None:
            raise
        print(f"{stage}: {message}", file=sys.stderr)
        return 2
    if not args.quiet:
        print_result(files, result)
    return 0
