"""kill -9 in every stage: afterwards make goes on and ends as an undisturbed run does."""

from __future__ import annotations

import os
import random
import shutil
import time
from contextlib import suppress
from pathlib import Path

from fileio.record import record_path
from pipeline.runs.run import targets
from pipeline.runs.stages import BY_NAME
from tests.studies.faults.project import (
    SCENE,
    TARGETS,
    compare_stages,
    kill,
    make,
    out_of,
    solver_gone,
    start,
)

LEFTOVERS = {  # what a stage keeps in order to resume
    "images": ("images.h5.part", "images.h5.particles.npz", "images_truth.h5.part"),
    "piv": ("piv.h5.part",),
    "case": ("case",),
    "sheet": ("sheet.h5.part",),
    "run": ("case", "sweep.h5"),
    "figures": ("figures",),
}
ATTEMPTS = 30  # makes that may end before they are killed
Row = dict[str, object]


def undo(project: Path, stage: str) -> None:
    """Remove the files of a target."""
    out, left = out_of(project), LEFTOVERS.get(stage, ())
    for step in targets(stage):
        record_path(out, step).unlink(missing_ok=True)
        for path in [path for name in (*BY_NAME[step].outputs, *left) for path in out.glob(name)]:
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
    if stage == "run":  # a new case, without the solver's files
        done = make(project, f"{SCENE}.case")
        assert done.returncode == 0, done.stderr


def undisturbed(project: Path, wanted: Path) -> dict[str, float]:
    """Run every stage and copy their files to `wanted`; the duration (s) of each."""
    durations = {}
    for stage in TARGETS:
        begin = time.monotonic()
        done = make(project, f"{SCENE}.{stage}")
        assert done.returncode == 0, done.stderr[-2000:]
        durations[stage] = time.monotonic() - begin
    shutil.copytree(out_of(project), wanted)
    return durations


def _writes(out: Path, begun: float) -> bool:
    """Whether a file has been written since `begun`."""
    # os.walk passes over files that vanish meanwhile; Path.rglob does so only from Python 3.13 on
    for folder, _, names in os.walk(out):
        for path in (Path(folder) / name for name in names if not name.endswith(".lock")):
            with suppress(OSError):
                if path.stat().st_mtime > begun:
                    return True
    return False


def _strike(project: Path, stage: str, duration: float, draw: random.Random, log: Path) -> bool:
    """Start a stage and kill it at any time or when it writes; False where it ended before."""
    out, writing = out_of(project), draw.random() < 0.5
    delay = draw.uniform(0, 1) * duration
    begun = time.time()
    process = start(project, f"{SCENE}.{stage}", log)
    deadline = time.monotonic() + (20 * duration if writing else delay)
    while time.monotonic() < deadline and process.poll() is None:
        if writing and _writes(out, begun):
            time.sleep(draw.uniform(0, 0.1 * duration))
            break
        time.sleep(0.002)
    if process.poll() is not None:
        return False
    kill(process)
    return True


def kills_in(
    project: Path, wanted: Path, stage: str, duration: float, count: int, seed: str, log: Path
) -> Row:
    """Kill a stage `count` times, one to three times in succession, let it end, and compare."""
    draw, kills, attempts, compared = random.Random(seed), 0, 0, 0

    def row(difference: str = "") -> Row:
        return {
            "stage": stage, "kills": kills, "runs_compared": compared, "difference": difference,
        }  # fmt: skip

    while kills < count and attempts < ATTEMPTS:
        undo(project, stage)
        in_succession = draw.choice((1, 2, 3))
        while in_succession and kills < count and attempts < ATTEMPTS:
            attempts += 1
            begun = time.monotonic()
            if not _strike(project, stage, duration, draw, log):
                duration = min(duration, time.monotonic() - begun)  # numba has compiled by now
                undo(project, stage)
                continue
            kills += 1
            in_succession -= 1
            if not solver_gone(project):
                return row("a solver lives on")
        done = make(project, f"{SCENE}.{stage}")
        compared += 1
        if done.returncode != 0:
            return row(f"does not go on: {done.stderr.strip()[-300:]}")
        left = ", ".join(path.name for path in out_of(project).rglob("*.part"))
        difference = compare_stages([stage], wanted, out_of(project))
        if difference or left:
            return row(difference or f"{left} left behind")
    return row()
