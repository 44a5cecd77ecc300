"""Stage run: the solver, through MPI where asked; resumes, guards, and writes its results as tables."""

from __future__ import annotations

import argparse
import fcntl
import json
import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from tqdm import tqdm

from pipeline.checkpoint import drop_legs, last_checkpoint
from pipeline.errors import StageError
from pipeline.foamfile import END, read_labels, write_bytes, write_list
from pipeline.frames import remove_frames, steps_of, write_frames
from pipeline.motion import read_motion
from pipeline.openfoam import (
    die_with_parent,
    environment_in,
    foam_version,
    last_lines,
    run_tool,
    solver_command,
)
from pipeline.partition import partition_columns
from pipeline.quality import cell_centres, neighbours, planform_edges
from pipeline.results import collect_results
from pipeline.scene import Scene
from pipeline.stage import guarded, parser, read_dataset, timed, versions, write_text

LOG = "log.pimpleFoam"
CELLS_PER_RANK = 5000  # fewer, and ranks wait for each other longer than they work
PROGRESS = "progress.json"  # what earlier legs of the run cost, and whether it has ended
NOTE_EVERY = 10.0  # s between notes of the time spent, for a run that is killed
STATE = "state.json"  # what the frames and the decomposition in case/ were made for


class Guard:
    """Watches the solver's log and says when a run has gone wrong."""

    def __init__(self, max_courant: float) -> None:
        self.max_courant = max_courant
        self.time = 0.0

    def verdict(self, line: str) -> str | None:
        """None while all is well, else the cause in a few words."""
        if line.startswith("Time = "):
            self.time = float(line.split("=")[1])
        elif line.startswith("Courant Number"):
            courant = float(line.split()[-1])
            if not courant <= self.max_courant:
                return f"Courant number {courant:.3g} exceeds numerics.max_courant = {self.max_courant:g}"
        elif line.startswith("time step continuity errors"):
            local = float(re.split(r"[=,]", line)[1])
            if not local < 1e-2:
                return f"continuity error {local:.3g}"
        return None


def prepare(scene: Scene, ranks: int, quiet: bool) -> None:
    """Decompose the case and lay the frames of the motion, unless that was done for the same mesh and ranks."""
    case = scene.out / "case"
    if not (case / "constant" / "polyMesh" / "points").exists():
        raise StageError(
            f"{case}: no mesh; run python -m pipeline.case {scene.folder} --level {scene.level} first"
        )
    wanted = _state(case, ranks)
    state = case / STATE
    if state.exists() and json.loads(state.read_text()) == wanted:
        return
    for stale in (state, case / PROGRESS):  # first: what is interrupted from here on must begin anew
        stale.unlink(missing_ok=True)
    for folder in case.glob("processor*"):
        shutil.rmtree(folder)
    for folder in case.iterdir():
        if folder.is_dir() and re.fullmatch(r"[0-9.e-]+", folder.name) and folder.name != "0":
            shutil.rmtree(folder)
    shutil.rmtree(case / "postProcessing", ignore_errors=True)
    with read_dataset(scene.out / "sweep.h5", "sweep") as sweep:
        sweep.load()
    with read_dataset(scene.out / "planform.h5", "planform") as planform:
        planform.load()
    node, level = sweep["node"].values, sweep["level"].values
    kind, top = scene.model.kind, planform.sizes["level"] - 1
    driving = (level == 0) | ((level == top) if kind == "full" else False)
    motion = read_motion(scene.out)
    steps = steps_of(scene.motion.end_time, scene.numerics.time_step)
    folders = [(case, np.arange(len(node)))]
    if ranks > 1:
        _decompose(case, sweep, planform, ranks)
        folders = []
        for rank in range(ranks):
            folder = case / f"processor{rank}"
            folders.append((folder, read_labels(folder / "constant" / "polyMesh" / "pointProcAddressing")))
    for folder, points in tqdm(folders, desc="frames", unit="rank", disable=quiet or None):
        write_frames(
            folder, motion, node[points], driving[points], scene.numerics.time_step, steps, flat=kind == "2d"
        )
    write_text(state, json.dumps(wanted))


def _decompose(case: Path, sweep: xr.Dataset, planform: xr.Dataset, ranks: int) -> None:
    column = sweep["cell_column"].values
    triangles, quads = planform["triangles"].values, planform["quads"].values
    centres = cell_centres(planform["points"].values[0], triangles, quads)
    load = np.bincount(column, minlength=len(centres)).astype(float)
    rank = partition_columns(centres, load, ranks, neighbours(planform_edges(triangles, quads)))[column]
    write_list(case / "constant" / "cellDecomposition", "labelList", "constant", rank)
    set_number(case, "ranks", str(ranks))
    run_tool(["decomposePar", "-force", "-noFunctionObjects"], case, "log.decomposePar")


def set_number(case: Path, key: str, value: str) -> None:
    """Change one entry of system/numbers."""
    path = case / "system" / "numbers"
    text, count = re.subn(rf"(?m)^{key}\s.*;", f"{key:<23} {value};", path.read_text())
    if count != 1:
        raise StageError(f"{path}: entry {key!r} occurs {count} times; run the case stage again")
    write_text(path, text)


def solve(scene: Scene, ranks: int, hosts: Path | None, quiet: bool) -> dict[str, Any]:
    """Run the solver to the end from the last whole checkpoint; returns what run.json records of it."""
    case = scene.out / "case"
    record_path = case / PROGRESS
    record: dict[str, Any] = {"wall_time": 0.0, "resumed": []}
    if record_path.exists():
        record = json.loads(record_path.read_text())
    if record.get("ended"):
        return record
    checkpoint = last_checkpoint(case, ranks)
    start, name = checkpoint or (0.0, "0")
    if checkpoint is not None:
        record["resumed"] = [*record["resumed"], start]
        reset_displacement([case] if ranks == 1 else sorted(case.glob("processor*")), name)
    drop_legs(case, start)
    set_number(case, "startTime", name)
    end = scene.motion.end_time
    log = case / LOG
    guard = Guard(scene.numerics.max_courant)
    begin = time.monotonic()
    noted = begin

    def note(ended: bool = False) -> dict[str, Any]:
        spent = {**record, "wall_time": float(record["wall_time"]) + time.monotonic() - begin, "ended": ended}
        write_text(record_path, json.dumps(spent))
        return spent

    # line by line: what a kill leaves in the log is whole lines
    with open(log, "a" if checkpoint else "w", buffering=1, encoding="utf-8") as output:
        output.write("\n")  # the leg before may have ended within a line
        process = subprocess.Popen(
            solver_command(ranks, hosts),
            cwd=case,
            env=environment_in(case),
            preexec_fn=die_with_parent,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            bufsize=1,
            start_new_session=True,
        )
        assert process.stdout is not None
        try:
            with tqdm(total=end, initial=start, unit="s", disable=quiet or None, desc="solver",
                      bar_format="{desc}: {percentage:3.0f}%|{bar}| {n:.3f}/{total:.3f} s [{elapsed}<{remaining}]") as bar:  # fmt: skip
                for line in process.stdout:
                    output.write(line)
                    cause = guard.verdict(line)
                    if cause:
                        raise StageError(
                            f"stopped at {guard.time:g} s by a guard: {cause}; the fields are kept in {case}:"
                            " lower numerics.time_step or refine the mesh"
                        )
                    if line.startswith("Time = "):
                        if time.monotonic() - noted > NOTE_EVERY:
                            noted = time.monotonic()
                            note()
                        bar.update(min(guard.time, end) - bar.n)
        except BaseException:
            _stop(process)
            raise
        finally:
            note()
    if process.wait() != 0:
        raise StageError(
            f"pimpleFoam failed at {guard.time:g} s (log: {log}); its last lines:\n{last_lines(log)}"
        )
    return note(ended=True)


def reset_displacement(folders: list[Path], time_name: str) -> None:
    """Start a resumed run's pointDisplacement from that of time 0.

    It is computed anew from the frames in the first step, and v1912 cannot read back a list of values on a patch with a
    patchType ("compound has already been transferred").
    """
    for folder in folders:
        first = (folder / "0" / "pointDisplacement").read_bytes().rstrip()
        write_bytes(
            folder / time_name / "pointDisplacement", first + END
        )  # END: a whole file, for the next resumption


def useful_ranks(scene: Scene, ranks: int, quiet: bool) -> int:
    """`ranks`, or fewer where the mesh is too small for them."""
    with read_dataset(scene.out / "sweep.h5", "sweep") as sweep:
        cells = sweep.sizes["cell"]
    useful = max(1, min(ranks, cells // CELLS_PER_RANK))
    if useful < ranks and not quiet:
        print(f"run: {cells} cells are too few for {ranks} ranks; {useful} used")
    return useful


def begun_ranks(case: Path, ranks: int, quiet: bool) -> int:
    """`ranks`, or those of an interrupted run that can be gone on with: its fields lie in as many folders."""
    state = case / STATE
    began = json.loads(state.read_text()) if state.exists() else {}
    if began != _state(case, began.get("ranks", 0)) or began["ranks"] == ranks:
        return ranks
    if last_checkpoint(case, began["ranks"]) is None:
        return ranks
    if not quiet:
        print(
            f"run: goes on with the {began['ranks']} ranks it began with, not {ranks} (remove {case} to begin anew)"
        )
    return int(began["ranks"])


def _state(case: Path, ranks: int) -> dict[str, int]:
    """What frames, decomposition and fields in `case` belong to."""
    return {"ranks": ranks, "mesh": (case / "constant" / "polyMesh" / "points").stat().st_mtime_ns}


@contextmanager
def only_one(lock: Path) -> Iterator[None]:
    """Hold `lock`; StageError where another run holds it."""
    if not lock.parent.is_dir():
        raise StageError(f"{lock.parent}: no case; run the case stage first")
    with open(lock, "w", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise StageError(f"{lock.parent}: another run is at work here; wait for it or stop it") from None
        yield


def _stop(process: subprocess.Popen[str]) -> None:
    """End the solver and all its ranks."""
    try:
        os.killpg(process.pid, signal.SIGTERM)
        process.wait(timeout=10)
    except ProcessLookupError:
        pass
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def run(scene: Scene, quiet: bool = False, ranks: int = 1, hosts: Path | None = None) -> float:
    """Solve and write run/forces.csv, power.csv, history.csv and, last, run.json; returns seconds of earlier legs."""
    begin = time.monotonic()
    version = foam_version()
    ranks = useful_ranks(scene, ranks, quiet)
    with only_one(scene.out / "case" / ".lock"):
        ranks = begun_ranks(scene.out / "case", ranks, quiet)
        prepare(scene, ranks, quiet)
        record = solve(scene, ranks, hosts, quiet)
    earlier = max(0.0, float(record["wall_time"]) - (time.monotonic() - begin))
    case = scene.out / "case"
    summary = collect_results(scene, case, scene.out / "run")
    write_text(
        scene.out / "run" / "run.json",
        json.dumps(
            {
                "format": "run",
                "format_version": 1,
                "versions": {"OpenFOAM": version} | versions(),
                "scene_hash": scene.digest(),
                "scene": scene.name,
                "level": scene.level,
                "model": scene.model.kind,
                "ranks": ranks,
                "time_step": scene.numerics.time_step,
                "end_time": scene.motion.end_time,
                "steps": steps_of(scene.motion.end_time, scene.numerics.time_step),
                "wall_time": round(float(record["wall_time"]), 2),
                "resumed": record["resumed"],
            }
            | summary,
            indent=1,
        )
        + "\n",
    )
    for folder in [case, *case.glob("processor*")]:
        remove_frames(folder)
    if not quiet:
        balance = summary["power_balance"]
        print(
            f"run: {record['wall_time']:.0f} s of solver, power balance closes to {balance['closure_fraction']:.1%}"
        )
    return earlier


def main() -> None:
    """Command line of the stage."""
    arguments = parser("run", __doc__)
    arguments.add_argument("--ranks", type=int, default=1, help="MPI ranks (default: %(default)s)")
    arguments.add_argument("--hosts", type=Path, help="MPI host file")
    args = arguments.parse_args()

    def action(scene: Scene, quiet: bool) -> float:
        return run(scene, quiet, _checked_ranks(args), _checked_hosts(args))

    guarded("run", lambda: timed("run", args, action))


def _checked_ranks(args: argparse.Namespace) -> int:
    if args.ranks < 1:
        raise StageError(f"--ranks {args.ranks}: give 1 or more")
    return int(args.ranks)


def _checked_hosts(args: argparse.Namespace) -> Path | None:
    if args.hosts is None:
        return None
    if not args.hosts.is_file():
        raise StageError(f"--hosts {args.hosts}: no such file; give an MPI host file, one host per line")
    return Path(args.hosts.resolve())  # the solver runs in another folder


if __name__ == "__main__":
    main()
