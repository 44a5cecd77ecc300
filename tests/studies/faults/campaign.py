"""kill -9 at any time of a whole run, of one process or of all: what it ends with equals an undisturbed run, bit for bit.

python -m tests.studies.faults.campaign [--kills 60] [--folder FOLDER]   (hours; rows are written as they come)
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from tests.inner_make import inner_environment
from tests.studies.faults.__main__ import write_table
from tests.studies.faults.project import PRODUCTS, command, compare_stage, copy_project, kill, solver_gone

COLUMNS = ("scene", "ranks", "kills_of_all", "kills_of_one", "resumed", "runs_compared", "difference", "date")
STAGES = tuple(PRODUCTS)[: list(PRODUCTS).index("vortices") + 1]
SOLVER = ("case", "run", "sheet")  # what takes longest, and is resumed within
MOST_IN_A_ROW = 6  # kills of one run
PATIENCE = 120.0  # s for a make to end whose process was killed
FINE = """# Cells enough for two ranks, and a part of the motion.
extends = "../{scene}"
title = "Fine {scene}"
[motion]
end_time = {end}
[levels.smoke]
mesh = {{ wall_cell = 1.2e-3, wall_first_layer = 0.5e-3, wall_layers = 2, tip_cell = 0.8e-3, near_cell = 1.4e-3, near_distance = 0.03, far_cell = 0.012 }}
numerics = {{ time_step = 1e-3, non_orthogonal_correctors = 0, max_courant = 30.0 }}
"""


class Chain(NamedTuple):
    """A scene and the ranks on which it is solved."""

    scene: str
    ranks: int


CHAINS = (
    Chain("single_finger", 1),
    Chain("pinch", 1),
    Chain("fine_single_finger", 2),
    Chain("fine_pinch", 2),
)
ENDS = {"fine_single_finger": 0.12, "fine_pinch": 0.3}  # s


def begin(project: Path, chain: Chain, last: str, log: Path) -> subprocess.Popen:
    """A make of all stages up to the `last`."""
    target = command(f"{chain.scene}.{last}", "smoke", chain.ranks)
    with log.open("a") as output:
        return subprocess.Popen(
            target, cwd=project, stdout=output, stderr=output, start_new_session=True, env=inner_environment()
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


def kill_one(process: subprocess.Popen, draw: random.Random) -> None:
    """kill -9 of any one process of a make, which then ends by itself."""
    pids = descendants(process.pid)
    if pids:
        with suppress(ProcessLookupError):
            os.kill(draw.choice(pids), signal.SIGKILL)
    with suppress(subprocess.TimeoutExpired):
        process.wait(PATIENCE)
    if process.poll() is None:
        kill(process)


def killed_run(project: Path, chain: Chain, stages: tuple[str, ...], wanted: Path, duration: float, most: int, draw: random.Random,
               log: Path, row: dict[str, object]) -> None:  # fmt: skip
    """One run of `stages` from nothing, killed up to `most` times, then let end and compared; `row` counts."""
    out = project / "cases" / chain.scene / "out" / "smoke"
    for made in (*(name for stage in stages for name in PRODUCTS[stage]), "case"):
        shutil.rmtree(out / made) if (out / made).is_dir() else (out / made).unlink(missing_ok=True)
    for _ in range(draw.randint(2, MOST_IN_A_ROW)):
        if int(str(row["kills_of_all"])) + int(str(row["kills_of_one"])) >= most:
            break
        process = begin(project, chain, stages[-1], log)
        with suppress(subprocess.TimeoutExpired):
            process.wait(draw.uniform(0.02, 0.6) * duration)
        if process.poll() is not None:
            break
        if draw.random() < 0.5:
            kill(process)
            row["kills_of_all"] = int(str(row["kills_of_all"])) + 1
        else:
            kill_one(process, draw)
            row["kills_of_one"] = int(str(row["kills_of_one"])) + 1
        if not solver_gone(project, 60.0):
            row["difference"] = "a solver lives on"
            return
    code = begin(project, chain, stages[-1], log).wait()
    row["runs_compared"] = int(str(row["runs_compared"])) + 1
    if code != 0:
        row["difference"] = f"does not go on: {log.read_text(errors='replace')[-300:]}"
        return
    text = (out / "run" / "run.json").read_text()
    row["resumed"] = int(str(row["resumed"])) + ('"resumed": []' not in text)
    differences = [difference for stage in stages if (difference := compare_stage(stage, wanted, out))]
    left = [path.name for path in out.rglob("*.part")]
    row["difference"] = "; ".join([*differences, *(f"{name} left behind" for name in left)])


def main() -> int:
    """Command line; 1 where a run differs from the undisturbed one."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.faults.campaign", description=__doc__)
    parser.add_argument("--kills", type=int, default=60, help="of all scenes together (default: %(default)s)")
    parser.add_argument("--solver", action="store_true", help="the stages case, run and sheet only")
    parser.add_argument("--seed", type=int, default=0, help="of their times (default: %(default)s)")
    parser.add_argument(
        "--folder", type=Path, help="where the copy of the project is kept (default: temporary)"
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/stability/campaign.csv"))
    args = parser.parse_args()
    draw = random.Random(args.seed)
    stages = SOLVER if args.solver else STAGES
    with tempfile.TemporaryDirectory() as temporary:
        folder = (args.folder or Path(temporary)).resolve()
        project, log = folder / "project", folder / "log"
        if not project.exists():
            copy_project(project)
            for name, end in ENDS.items():
                scene = project / "cases" / name
                scene.mkdir()
                text = FINE.format(scene=name.removeprefix("fine_"), end=end)
                (scene / "scene.toml").write_text(text, encoding="utf-8")
        rows: dict[Chain, dict[str, object]] = {}
        durations: dict[Chain, float] = {}
        while True:
            for chain in CHAINS:
                kept = folder / "wanted" / chain.scene
                out = project / "cases" / chain.scene / "out" / "smoke"
                if chain not in rows:
                    started = time.monotonic()
                    if not kept.exists():
                        code = begin(project, chain, stages[-1], log).wait()
                        assert code == 0, log.read_text(errors="replace")[-2000:]
                        shutil.copytree(out, kept)
                    durations[chain] = max(time.monotonic() - started, 60.0)
                    zero = dict.fromkeys(COLUMNS[2:6], 0)
                    rows[chain] = {"scene": chain.scene, "ranks": chain.ranks, **zero, "difference": ""}
                row = rows[chain]
                most = -(-args.kills // len(CHAINS))
                if row["difference"] or int(str(row["kills_of_all"])) + int(str(row["kills_of_one"])) >= most:
                    continue
                killed_run(project, chain, stages, kept, durations[chain], most, draw, log, row)
                print(row, flush=True)
                write_table(args.output, COLUMNS, list(rows.values()))
            done = [row for row in rows.values() if row["difference"]
                    or int(str(row["kills_of_all"])) + int(str(row["kills_of_one"])) >= most]  # fmt: skip
            if len(done) == len(CHAINS):
                return int(any(row["difference"] for row in rows.values()))


if __name__ == "__main__":
    sys.exit(main())
