"""Run a scene's stages to their end, whatever it is, and note it: for runs of a study that may fail."""

from __future__ import annotations

import argparse
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from fileio.command import add_scene
from fileio.formats.records import OUTCOME
from fileio.stages import BY_NAME
from pipeline.openfoam.environment import die_with_parent
from pipeline.study.table import MAY_FAIL_UNTIL

LONGEST = 7200.0  # s of a stage, beyond which it is taken to hang
LONGEST_REASON = 400  # characters
NAME = "outcome.json"


def outcome_of(code: int, said: str) -> dict[str, Any]:
    """The outcome of a stage by its exit code and its last words: refused, stopped (by a guard), failed or crashed.

    Exit code 2 is a foreseen failure in one sentence; any other is one of the program's own.
    """
    lines = [line for line in said.splitlines() if line.strip()]
    if code != 2 or "Traceback (most recent call last)" in said:
        return {"ended": "crashed", "reason": lines[-1] if lines else f"exit code {code}"}
    text = " ".join(said.split())
    stopped = re.search(r"stopped at ([-+\d.e]+) s", text)
    if stopped:
        return {"ended": "stopped", "stopped_at_s": float(stopped.group(1)), "reason": text}
    return {
        "ended": "failed" if re.search(r"failed (at|in)\b", text) else "refused",
        "reason": text,
    }


def run_stage(command: list[str], longest: float = LONGEST) -> tuple[int, str] | None:
    """Exit code and standard error of a stage; None where it was not over after `longest` seconds."""
    process = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=die_with_parent,
    )
    try:
        _, said = process.communicate(timeout=longest)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return None
    return process.returncode, said


def outcome(folder: Path, level: str, until: str, ranks: int) -> dict[str, Any]:
    """Run the stages up to `until`; how it ended, at which stage, why, and the CPU seconds it took."""
    result: dict[str, Any] = {"ended": "completed", "stage": until, "reason": ""}
    for stage in MAY_FAIL_UNTIL[: MAY_FAIL_UNTIL.index(until) + 1]:
        command = [
            sys.executable,
            "-m",
            "pipeline",
            stage,
            str(folder),
            "--level",
            level,
            "--quiet",
        ]
        done = run_stage(command + ["--ranks", str(ranks)] * BY_NAME[stage].ranks)
        if done is None:
            result = {
                "ended": "hung",
                "stage": stage,
                "reason": f"not over after {LONGEST / 60:g} minutes",
            }
            break
        if done[0] != 0:
            result = {"stage": stage} | outcome_of(*done)
            break
    for place in (folder.resolve(), folder):  # reasons hold wherever the project lies
        result["reason"] = result["reason"].replace(f"{place}/", "")
    result["reason"] = result["reason"][:LONGEST_REASON]
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return result | {"cpu_s": round(used.ru_utime + used.ru_stime, 1)}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command `outcome`."""
    add_scene(parser)
    parser.add_argument(
        "--until", choices=MAY_FAIL_UNTIL, default="run", help="last stage (default: %(default)s)"
    )
    parser.add_argument("--ranks", type=int, default=1, help="MPI ranks (default: %(default)s)")


def run(args: argparse.Namespace) -> None:
    """Command `outcome`. The solver's case is removed where no later stage of the run would read it."""
    out = args.scene / "out" / args.level
    result = outcome(args.scene, args.level, args.until, args.ranks)
    if args.until == "run":
        shutil.rmtree(out / "case", ignore_errors=True)
    OUTCOME.write(out / NAME, result)
    if not args.quiet:
        print(f"outcome: {result['ended']} at {result['stage']} {result['reason']}".rstrip())
