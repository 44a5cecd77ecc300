"""The command line of one stage: arguments, and its run with a lock and a cost record."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fileio.command import guarded
from fileio.cost import NOTHING, record_cost
from fileio.lock import exclusive
from pipeline.scene.scene import Scene, load_scene


def parser(stage: str, doc: str | None) -> argparse.ArgumentParser:
    """Arguments that all stages take: the scene's folder and the level."""
    result = argparse.ArgumentParser(prog=f"python -m pipeline.{stage}", description=doc)
    result.add_argument("scene", type=Path, help="folder of the scene, as cases/single_finger")
    result.add_argument("--level", default="coarse", help="level of the scene (default: %(default)s)")
    result.add_argument("--quiet", action="store_true", help="print nothing but errors")
    return result


def run_stage(stage: str, doc: str | None, run: Callable[[Scene, bool], Any]) -> None:
    """Entry point of `python -m pipeline.<stage>`; exits 2 with one sentence on a StageError."""
    args = parser(stage, doc).parse_args()
    guarded(stage, lambda: timed(stage, args, run))


def timed(stage: str, args: argparse.Namespace, run: Callable[[Scene, bool], Any]) -> None:
    """Load the scene, run the stage, record what it cost."""
    scene = load_scene(args.scene, args.level)
    scene.out.mkdir(parents=True, exist_ok=True)
    begin = time.monotonic()
    with exclusive(scene.out / stage):
        earlier = run(scene, args.quiet) or NOTHING  # by runs that this one resumed
    record_cost(scene.out / "costs" / f"{stage}.json", stage, time.monotonic() - begin, earlier)
