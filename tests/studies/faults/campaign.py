"""kill -9 of whole runs, eight times in succession each: what they end with equals an undisturbed run, bit for bit.

python -m tests.studies.faults.campaign [--folder FOLDER] [--runs 0,1]   (hours; goes on where it was interrupted)
"""

from __future__ import annotations

import argparse
import csv
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from fileio.atomic import write_text
from fileio.stages import BY_NAME
from tests.inner_make import inner_environment
from tests.studies.faults.__main__ import write_table
from tests.studies.faults.project import (
    PRODUCTS,
    command,
    compare_stage,
    copy_project,
    kill,
    solver_gone,
)

COLUMNS = (
    "scene",
    "level",
    "ranks",
    "end_time",
    "kill",
    "stage",
    "solved_s",
    "killed",
    "compared",
    "date",
)
LAST = ("compare", "loads")
STAGES = (*list(PRODUCTS)[: list(PRODUCTS).index("compare") + 1], "loads")
BEFORE, AFTER = (
    ("mesh", "case"),
    (("sheet", "images"), ("images", "piv"), ("vortices_piv", "compare")),
)
SOLVED = (
    0.05,
    0.3,
    0.5,
    0.75,
    0.97,
)  # of the end time: a kill of the solver between each and the next
PATIENCE = 120.0  # s for a make to end whose process was killed
POLL = 0.2  # s

# A scene of its own, since a level's numbers are replaced whole: `smoke` has too few cells for two ranks.
FINE = """
[levels.smoke]
mesh = { wall_cell = 1.2e-3, wall_first_layer = 0.5e-3, wall_layers = 2, tip_cell = 0.8e-3, near_cell = 1.4e-3, near_distance = 0.03, far_cell = 0.012 }
numerics = { time_step = 1e-3, non_orthogonal_correctors = 0, max_courant = 30.0 }
"""


class Run(NamedTuple):
    """A scene at a level on some ranks, to a time (s) before that of the scene where that takes too long."""

    scene: str
    level: str
    ranks: int
    end_time: float

    @property
    def name(self) -> str:
        """Of its own scene folder."""
        return f"{self.scene}_{self.level}_{self.ranks}"

    def out(self, project: Path) -> Path:
        """Where its results are."""
        return project / "cases" / self.name / "out" / self.level

    def scene_text(self) -> str:
        """Its scene.toml."""
        text = f'extends = "../{self.scene}"\ntitle = "{self.name}"\n[motion]\nend_time = {self.end_time}\n'
        return text + (FINE if self.level == "smoke" and self.ranks > 1 else "")


RUNS = (
    Run("single_finger", "smoke", 1, 0.42),
    Run("pinch", "smoke", 1, 0.64),
    Run("single_finger", "draft", 1, 0.08),
    Run("pinch", "draft", 1, 0.1),
    Run("single_finger", "smoke", 2, 0.08),
    Run("pinch", "smoke", 2, 0.08),
    Run("single_finger", "draft", 2, 0.08),
    Run("pinch", "draft", 2, 0.08),
)
Aim = tuple[
    str, Callable[[], bool], float
]  # a stage, what must be true before it is killed, and s after that


def begin(project: Path, run: Run, log: Path) -> subprocess.Popen:
    """A make of all stages."""
    first, *others = (f"{run.name}.{target}" for target in LAST)
    target = [*command(first, run.level, run.ranks), *others]
    with log.open("a") as output:
        return subprocess.Popen(
            target,
            cwd=project,
            stdout=output,
            stderr=output,
            start_new_session=True,
            env=inner_environment(),
        )


def descendants(pid: int) -> list[int]:
    """The processes that one has started, and those have."""
    children: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            words = stat.read_text().rsplit(")", 1)[1].split()
            children.setdefault(int(words[1]), []).append(int(stat.parent.name))
    pids, at = [], [pid]
    while at:
        at = [child for parent in at for child in children.get(parent, ())]
        pids += at
    return pids


def kill_one(process: subprocess.Popen, draw: random.Random) -> str | None:
    """kill -9 of any one process of a make, which then ends by itself; the name of the one, None where make ended before."""
    name = None
    while name is None and process.poll() is None:
        with suppress(OSError, IndexError):  # it has ended since, or there is none at the moment
            pid = draw.choice(descendants(process.pid))
            found = Path(f"/proc/{pid}/comm").read_text().strip()
            os.kill(pid, signal.SIGKILL)
            name = found
    if name is None:
        return None
    with suppress(subprocess.TimeoutExpired):
        process.wait(PATIENCE)
    if process.poll() is None:
        kill(process)
        name += ", and all after it went on"
    return name


def solved(out: Path) -> float:
    """How far (s) the solver has told that it is."""
    times = [0.0]
    for log in (out / "case").glob("*/log.pimpleFoam"):
        times += [
            float(t) for t in re.findall(r"(?m)^Time = (\S+)$", log.read_text(errors="replace"))
        ]
    return max(times)


def aims(run: Run, project: Path, wanted: Path, draw: random.Random) -> list[Aim]:
    """The eight kills of a run: one before the solver, four in it, three after it, each at a drawn time."""
    out = run.out(project)

    def stage(name: str) -> Aim:
        def done(folder: Path, of: str) -> Path:
            return folder / BY_NAME[of].done

        needs = BY_NAME[name].inputs
        took = done(wanted, name).stat().st_mtime - max(
            done(wanted, n).stat().st_mtime for n in needs
        )
        return (
            name,
            lambda: all(done(out, n).exists() for n in needs),
            draw.uniform(0, 1) * max(took, 1.0),
        )

    def solver(low: float, high: float) -> Aim:
        at = draw.uniform(low, high) * run.end_time
        return "run", lambda: solved(out) >= at, 0.0

    during = [solver(*limits) for limits in pairwise(SOLVED)]
    return [stage(draw.choice(BEFORE)), *during, *(stage(draw.choice(names)) for names in AFTER)]


def strike(
    project: Path, run: Run, aim: Aim, of_all: bool, draw: random.Random, log: Path
) -> str | None:
    """Begin a make, kill it (or one of its processes) at its aim, and return what was killed; None where it ended before."""
    _, ready, delay = aim
    process = begin(project, run, log)
    while not ready() and process.poll() is None:
        time.sleep(POLL)
    with suppress(subprocess.TimeoutExpired):
        process.wait(delay)
    if process.poll() is not None:
        return None
    if not of_all:
        return kill_one(process, draw)
    kill(process)
    return "all"


def undisturbed(project: Path, run: Run, wanted: Path, log: Path) -> None:
    """Make the results of `run` that the killed one is compared with, once."""
    if wanted.exists():
        return
    out = run.out(project)
    shutil.rmtree(out, ignore_errors=True)
    write_text(out.parents[1] / "scene.toml", run.scene_text())
    reference = project / "cases" / run.scene / "reference"
    shutil.copytree(reference, out.parents[1] / "reference", dirs_exist_ok=True)
    code = begin(project, run, log).wait()
    if code != 0:
        raise SystemExit(
            f"{run.name} does not run undisturbed: {log.read_text(errors='replace')[-2000:]}"
        )
    case = shutil.ignore_patterns("case")  # the rest with the files' times
    shutil.copytree(out, wanted.with_suffix(".part"), ignore=case, dirs_exist_ok=True)
    wanted.with_suffix(".part").rename(wanted)


def kills(
    project: Path, run: Run, wanted: Path, seed: int, log: Path, done: int
) -> Iterator[dict[str, object]]:
    """Kill `run` eight times in succession, from nothing where none is `done` yet: a row for each kill."""
    out = run.out(project)
    if not done:
        shutil.rmtree(out, ignore_errors=True)
    same = {"scene": run.scene, "level": run.level, "ranks": run.ranks, "end_time": run.end_time}
    draw = random.Random(f"{seed}{run.name}")
    first = draw.randint(0, 1)
    for number, aim in list(enumerate(aims(run, project, wanted, draw)))[done:]:
        killed = strike(project, run, aim, (number + first) % 2 == 0, draw, log)
        if killed and not solver_gone(project, 60.0):
            killed += ", but a solver lives on"
        solver_at = f"{solved(out):.4g}"
        row = {
            "kill": number + 1,
            "stage": aim[0],
            "solved_s": solver_at,
            "killed": killed or "ended before",
        }
        yield same | row


def compared(project: Path, run: Run, wanted: Path, log: Path) -> str:
    """Let a killed run end; "equal", or what differs from the undisturbed one."""
    out = run.out(project)
    if begin(project, run, log).wait() != 0:
        return f"does not go on: {log.read_text(errors='replace')[-300:]}"
    differences = [d for stage in STAGES if (d := compare_stage(stage, wanted, out))]
    left = [f"{path.name} left behind" for path in out.rglob("*.part")]
    return "; ".join([*differences, *left]) or "equal"


def main() -> int:
    """Command line; 1 where a run differs from the undisturbed one."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.studies.faults.campaign", description=__doc__
    )
    parser.add_argument(
        "--runs", help=f"numbers with commas, of 0 to {len(RUNS) - 1} (default: all)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the kills (default: %(default)s)")
    parser.add_argument(
        "--folder", type=Path, help="where the copy of the project is kept (default: temporary)"
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/stability/kills.csv"))
    args = parser.parse_args()
    numbers = [int(n) for n in args.runs.split(",")] if args.runs else range(len(RUNS))
    with tempfile.TemporaryDirectory() as temporary:
        folder = (args.folder or Path(temporary)).resolve()
        project, output = folder / "project", args.output.resolve()
        if not project.exists():
            copy_project(project)
        rows: list[dict[str, object]] = []
        if output.exists():
            with output.open(encoding="utf-8", newline="") as file:
                rows = list(csv.DictReader(file))
        for run in (RUNS[n] for n in numbers):
            key = (run.scene, run.level, str(run.ranks))
            of_run = [row for row in rows if (row["scene"], row["level"], str(row["ranks"])) == key]
            if of_run and of_run[-1]["compared"]:
                continue
            wanted, log = folder / "wanted" / run.name, folder / f"log.{run.name}"
            wanted.parent.mkdir(exist_ok=True)
            undisturbed(project, run, wanted, log)
            for row in kills(project, run, wanted, args.seed, log, len(of_run)):
                print(row, flush=True)
                rows.append(row)
                of_run.append(row)
                write_table(output, COLUMNS, rows)
            result = compared(project, run, wanted, log)
            print(f"{run.name}: {result}", flush=True)
            for row in of_run:
                row["compared"] = result
            write_table(output, COLUMNS, rows)
    return int(any(row["compared"] != "equal" for row in rows))


if __name__ == "__main__":
    sys.exit(main())
