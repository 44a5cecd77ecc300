"""kill -9 in every stage: afterwards make goes on, and ends with what an undisturbed run ends with."""

from __future__ import annotations

import os
import random
import shutil
import time
from contextlib import suppress
from pathlib import Path

from tests.studies.faults.project import (
    PRODUCTS,
    SCENE,
    compare_stage,
    kill,
    make,
    out_of,
    solver_gone,
    start,
)

LEFTOVERS = {  # what a stage keeps to go on from: taken away before a new trial
    "images": ("images.h5.part", "images.h5.particles.npz", "images_truth.h5.part"),
    "piv": ("piv.h5.part",),
    "case": ("case",),
    "sheet": ("sheet.h5.part",),
    "run": ("case", "sweep.h5"),
    "figures": ("figures",),
}
ATTEMPTS = 30  # makes that may end before they are killed


def undo(project: Path, stage: str) -> None:
    """Take away what a stage has made."""
    out = out_of(project)
    for name in (*PRODUCTS[stage], *LEFTOVERS.get(stage, ())):
        path = out / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    if stage == "run":  # the case is made anew, without what the solver has put into it
        done = make(project, f"{SCENE}.case")
        assert done.returncode == 0, done.stderr


def undisturbed(project: Path, wanted: Path) -> dict[str, float]:
    """Run every stage, keep what it makes in `wanted`, and return how long each takes (s)."""
    out, durations = out_of(project), {}
    for stage, names in PRODUCTS.items():
        begin = time.monotonic()
        done = make(project, f"{SCENE}.{stage}")
        assert done.returncode == 0, done.stderr[-2000:]
        durations[stage] = time.monotonic() - begin
        for name in names:
            (wanted / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(out / name, wanted / name)
    return durations


def newest(out: Path, begun: float) -> bool:
    """Whether a file has been written since `begun`: the stage is at its files."""
    # os.walk passes over what the stage removes meanwhile, which Path.rglob does not before Python 3.13
    for folder, _, names in os.walk(out):
        for path in (Path(folder) / name for name in names if not name.endswith(".lock")):
            with suppress(OSError):
                if path.stat().st_mtime > begun:
                    return True
    return False


def strike(project: Path, stage: str, duration: float, draw: random.Random, log: Path) -> bool:
    """Start a stage and kill it: at any time, or just after it has begun to write; False where it ended before."""
    out, writing = out_of(project), draw.random() < 0.5
    delay = draw.uniform(0, 1) * duration
    begun = time.time()
    process = start(project, f"{SCENE}.{stage}", log)
    deadline = time.monotonic() + (delay if not writing else 20 * duration)
    while time.monotonic() < deadline and process.poll() is None:
        if writing and newest(out, begun):
            time.sleep(draw.uniform(0, 0.1 * duration))
            break
        time.sleep(0.002)
    if process.poll() is not None:
        return False
    kill(process)
    return True


def kills_in(
    project: Path,
    wanted: Path,
    stage: str,
    duration: float,
    count: int,
    draw: random.Random,
    log: Path,
) -> dict[str, object]:
    """Kill a stage `count` times, one to three times in a row, then let it end and compare; a row of the table."""
    row: dict[str, object] = {"stage": stage, "kills": 0, "runs_compared": 0, "difference": ""}
    kills, attempts = 0, 0
    out = out_of(project)
    while kills < count and attempts < ATTEMPTS:
        undo(project, stage)
        in_a_row = draw.choice((1, 2, 3))
        while in_a_row and kills < count and attempts < ATTEMPTS:
            attempts += 1
            begun = time.monotonic()
            if not strike(project, stage, duration, draw, log):
                duration = min(
                    duration, time.monotonic() - begun
                )  # what was compiled before is compiled now
                undo(project, stage)
                continue
            kills += 1
            in_a_row -= 1
            if not solver_gone(project):
                row["difference"] = "a solver lives on"
                return row | {"kills": kills}
        done = make(project, f"{SCENE}.{stage}")
        row["runs_compared"] = int(str(row["runs_compared"])) + 1
        if done.returncode != 0:
            return row | {
                "kills": kills,
                "difference": f"does not go on: {done.stderr.strip()[-300:]}",
            }
        difference = compare_stage(stage, wanted, out)
        left = [path.name for path in out.rglob("*.part")]
        if difference or left:
            return row | {
                "kills": kills,
                "difference": difference or f"{', '.join(left)} left behind",
            }
    return row | {"kills": kills}
