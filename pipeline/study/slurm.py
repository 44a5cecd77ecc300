"""Slurm batch scripts for one scene at one level: what comes before the solver, the solver on many ranks, what comes after.

Command: python -m pipeline.study.slurm cases/pinch --level fine --ranks 64 --submit (make pinch LEVEL=fine NP=64 SLURM=1)
"""

from __future__ import annotations

import argparse
import math
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from fileio.atomic import write_text
from fileio.command import guarded
from fileio.errors import StageError
from pipeline.scene.command import parser
from pipeline.scene.scene import Scene, load_scene
from pipeline.study.estimate import estimates
from pipeline.study.scaling_data import read_data, size
from pipeline.study.scaling_model import fit, useful_ranks
from pipeline.study.table import STAGES

RESTARTS = 50  # a job that needs more has another fault than too little time
WARNING = (
    120  # s before the limit at which the job is told, to stop the solver and put itself back in the queue
)
SERIAL_TASKS = 4  # cores of the jobs before and after the solver
BEFORE = STAGES[: STAGES.index("run")]
AFTER = (*STAGES[STAGES.index("run") + 1 :], "compare", "report")

HEAD = """#!/bin/bash
# Written by: {command}
#SBATCH --job-name={name}
{nodes}#SBATCH --ntasks={tasks}
#SBATCH --cpus-per-task={cpus}
#SBATCH --mem-per-cpu={memory}M
#SBATCH --time={time}
{more}#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --output={log}
"""

SOLVER = """#SBATCH --signal=B:USR1@{warning}

# The limit comes near: stop the solver and queue again. It goes on from its last checkpoint; what was computed since
# then (at most numerics.write_interval) is computed again.
again() {{
    echo "$(date -Is) time limit near: stopping for restart $(( ${{SLURM_RESTART_COUNT:-0}} + 1 ))"
    kill -TERM "$stage" 2>/dev/null
    wait "$stage"
    if [ "${{SLURM_RESTART_COUNT:-0}}" -lt {restarts} ]; then scontrol requeue "$SLURM_JOB_ID"; fi
    exit 1
}}
trap again USR1

echo "$(date -Is) restart ${{SLURM_RESTART_COUNT:-0}} on $SLURM_JOB_NODELIST"
{line} &
stage=$!
wait "$stage"
"""

PLAIN = """
unset MAKEFLAGS MFLAGS MAKELEVEL # of the make that submitted this: its SLURM=1 would submit again
{line}
"""


@dataclass(frozen=True)
class Request:
    """What is asked of the cluster: ranks, nodes (None: Slurm's choice), wall time (minutes), memory of all ranks, partition
    and account; and for the jobs before and after the solver a few cores of one node, their time and memory."""

    ranks: int
    minutes: int
    memory_mb: int
    nodes: int | None = None
    partition: str | None = None
    account: str | None = None
    serial_cores: int = SERIAL_TASKS
    serial_minutes: int = 240
    serial_memory_mb: int = 8000
    restarts: int = RESTARTS
    warning: int = WARNING
    collated: bool = False


def slurm_time(minutes: int) -> str:
    """Minutes as Slurm writes them, days-hours:minutes:seconds."""
    days, rest = divmod(minutes, 24 * 60)
    return f"{days}-{rest // 60:02d}:{rest % 60:02d}:00"


def scripts(scene: Scene, request: Request, make: str, python: str) -> dict[str, str]:
    """The texts of before.sbatch, run.sbatch and after.sbatch; they run in the project's folder."""
    name, level, slurm = scene.name, scene.level, scene.out / "slurm"
    cpus = request.serial_cores
    more = "".join(
        f"#SBATCH --{key}={value}\n"
        for key, value in (("partition", request.partition), ("account", request.account))
        if value
    )
    where = "" if scene.folder.parent == Path("cases") else f" CASES={scene.folder.parent}"
    command = f"make {name}{where} LEVEL={level} NP={request.ranks} SLURM=1"

    def head(step: str, tasks: int, cpus: int, nodes: int | None, memory: int, minutes: int) -> str:
        return HEAD.format(
            command=command, name=f"{name}.{level}.{step}", tasks=tasks, cpus=cpus, memory=memory, more=more,
            nodes="" if nodes is None else f"#SBATCH --nodes={nodes}\n", time=slurm_time(minutes),
            log=slurm / f"{step}.log",
        )  # fmt: skip

    solver = f"{python} -m pipeline.run.stage {scene.folder} --level {level} --ranks {request.ranks} --quiet"
    solver += " --collated" if request.collated else ""
    serial = {
        "before": f"{make} {name}.case{where} LEVEL={level} NP={cpus} QUIET=1 SLURM=",
        "after": f"{make} {name}{where} LEVEL={level} NP={cpus} QUIET=1 SLURM=",
    }
    per_rank = max(500, math.ceil(request.memory_mb / request.ranks))
    texts = {
        step: head(step, 1, cpus, 1, math.ceil(request.serial_memory_mb / cpus), request.serial_minutes)
        + PLAIN.format(line=line)
        for step, line in serial.items()
    }
    texts["run"] = head("run", request.ranks, 1, request.nodes, per_rank, request.minutes) + SOLVER.format(
        line=solver, restarts=request.restarts, warning=request.warning
    )
    return texts


def write_scripts(scene: Scene, texts: dict[str, str]) -> dict[str, Path]:
    """Write them to out/<level>/slurm/; returns their paths."""
    paths = {step: scene.out / "slurm" / f"{step}.sbatch" for step in texts}
    for step, text in texts.items():
        write_text(paths[step], text)
    return paths


def submit(paths: dict[str, Path]) -> dict[str, str]:
    """Queue the three jobs, each after the one before it has ended well; returns their numbers."""
    if shutil.which("sbatch") is None:
        raise StageError(
            f"Slurm is not here (no sbatch on the path); submit {paths['run'].parent}/*.sbatch where it is"
        )
    jobs: dict[str, str] = {}
    previous: str | None = None
    for step in ("before", "run", "after"):
        after = [f"--dependency=afterok:{previous}", "--kill-on-invalid-dep=yes"] if previous else []
        done = subprocess.run(
            ["sbatch", "--parsable", *after, str(paths[step])], capture_output=True, text=True
        )
        if done.returncode != 0:
            raise StageError(f"sbatch refused {paths[step]}: {done.stderr.strip()}")
        previous = jobs[step] = done.stdout.strip().split(";")[0]
    return jobs


def node_cores() -> int | None:
    """Cores of this cluster's largest node, where Slurm can be asked."""
    if shutil.which("sinfo") is None:
        return None
    done = subprocess.run(["sinfo", "--noheader", "--format=%c"], capture_output=True, text=True)
    cores = [int(n) for n in re.findall(r"\d+", done.stdout)]
    return max(cores) if done.returncode == 0 and cores else None


def default_ranks(scene: Scene, cores: int | None) -> tuple[int, str]:
    """Ranks where none are asked for, and why so many. StageError where nothing says it.

    As many as pay, where the mesh is there to predict it from; else `cores`, those of the largest node.
    """
    if (scene.out / "sweep.h5").exists():
        one, two, network = read_data()
        cells, columns = size(scene)
        ranks = useful_ranks(cells, columns, fit(one, two, network), network)
        return (
            ranks,
            f"as many as pay for {cells} cells (make predict SCENE={scene.name} LEVEL={scene.level})",
        )
    if cores:
        return cores, "as many as a node has cores; once the mesh is there, make predict says how many pay"
    raise StageError(
        f"how many ranks? give NP=…, or run make {scene.name}.case LEVEL={scene.level} first: then as many as pay"
    )


def asked(scene: Scene, args: argparse.Namespace) -> Request:
    """What the command line asks for, completed from measured costs and from what Slurm says of its nodes."""
    cores = node_cores()
    ranks = args.ranks
    if ranks is None:
        ranks, why = default_ranks(scene, cores)
        if not args.quiet:
            print(f"batch: {ranks} ranks: {why}")
    expected = estimates(scene, ranks, scene.folder)
    nodes = args.nodes or (math.ceil(ranks / cores) if cores else None)
    minutes = args.minutes or max(60, expected["run"]["minutes"])
    return Request(
        ranks, minutes, expected["run"]["memory_mb"], nodes, args.partition, args.account,
        serial_cores=min(SERIAL_TASKS, cores or SERIAL_TASKS),
        serial_minutes=max(60, *(sum(expected[stage]["minutes"] for stage in part) for part in (BEFORE, AFTER))),
        serial_memory_mb=max(4000, *(expected[stage]["memory_mb"] for stage in (*BEFORE, *AFTER))),
        collated=args.collated,
    )  # fmt: skip


def main() -> None:
    """Command line."""
    arguments = parser("batch", __doc__)
    arguments.add_argument("--ranks", type=int, help="MPI ranks (default: as many as pay, or a node's cores)")
    arguments.add_argument("--nodes", type=int, help="nodes (default: as many as the ranks fill)")
    arguments.add_argument(
        "--minutes", type=int, help="wall time until a restart (default: from measured costs, 60 at least)"
    )
    arguments.add_argument("--partition", help="Slurm partition (default: the cluster's)")
    arguments.add_argument("--account", help="Slurm account (default: yours)")
    arguments.add_argument(
        "--collated", action="store_true", help="one file for all ranks, as of the run stage"
    )
    arguments.add_argument("--submit", action="store_true", help="submit the scripts, not only write them")
    args = arguments.parse_args()

    def action() -> None:
        for name in ("ranks", "nodes", "minutes"):
            if (value := getattr(args, name)) is not None and value < 1:
                raise StageError(f"--{name} {value}: give 1 or more")
        scene = load_scene(args.scene, args.level)
        paths = write_scripts(scene, scripts(scene, asked(scene, args), "make", ".venv/bin/python"))
        if not args.quiet:
            print(f"batch: {', '.join(map(str, paths.values()))}")
        if args.submit:
            jobs = submit(paths)
            if not args.quiet:
                print(
                    "batch: jobs "
                    + ", ".join(f"{number} ({step})" for step, number in jobs.items())
                    + "; squeue shows them"
                )

    guarded("batch", action)


if __name__ == "__main__":
    main()
