"""Make the stale stages of a run, each in its own process, in parallel where possible."""

import math
import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import import_module
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkProcess
from pathlib import Path
from typing import Any

from tqdm import tqdm

from pipeline.openfoam.environment import check_openfoam, die_with_parent
from pipeline.runs.estimate import duration, estimate
from pipeline.runs.run import Run, targets
from pipeline.runs.seal import seal
from pipeline.runs.stages import FEA, Stage
from pipeline.runs.take_over import take_over
from pipeline.scene.measurement import piv_settings, render_settings
from pipeline.scene.scene import Scene
from piv.files.errors import StageError, one_line, printable, sentence, system_error
from piv.files.lock import exclusive
from piv.files.provenance import versions
from piv.files.record import (
    check_own,
    check_whole,
    forget,
    read_record,
    write_record,
)

_TIDY = 5.0  # s for a stage to end by itself after an interruption, before another and a kill
_HOUR = 3600.0  # s of CPU time that any stage may take
_LONGEST = 50.0  # times its estimate that a stage may take
_WAITING = 10.0  # times that limit, s by the clock: on a busy machine
_TICK = 0.5  # s between two checks of the processes
_END = "simplify the scene, or make its cells larger"
LOG = "log.txt"  # in a run's folder: what the stages print
_SETTINGS: dict[str, Callable[[Scene], dict[str, Any]]] = {
    "images": lambda scene: render_settings(scene.camera, scene.sheet),
    "piv": lambda scene: piv_settings(scene.piv, scene.camera),
    "pressure": lambda scene: scene.pressure_settings(),
    "vortices_cfd": lambda scene: scene.vortices.model_dump(mode="json"),
    "vortices_piv": lambda scene: scene.vortices.model_dump(mode="json"),
}


@dataclass(frozen=True)
class Machine:
    """MPI ranks, parallel threads and stages, MPI host file."""

    ranks: int = 1
    jobs: int = 1
    hosts: Path | None = None

    def __post_init__(self) -> None:
        if min(self.ranks, self.jobs) < 1:
            raise StageError(f"NP={self.ranks}: give 1 or more")
        if self.hosts is not None and not self.hosts.is_file():
            raise StageError(f"--hosts {self.hosts}: no such file; give one with a host per line")

    def options(self, stage: Stage) -> dict[str, Any]:
        """Options of a stage's function."""
        if stage.ranks:
            return {"ranks": self.ranks, "hosts": self.hosts}
        if stage is FEA:
            return {"processes": self.jobs}
        return {"threads": self.jobs} if stage.threads else {}


@dataclass
class _Job:
    """A stage in its process; `pipe`: its printed lines, then its exit code and error."""

    stage: str
    process: ForkProcess
    pipe: Connection
    begin: float
    limit: float  # s of CPU time
    ended: tuple[int, str] | None = None


def make(
    run: Run, target: str, machine: Machine, quiet: bool = False, longest: float = float("inf"),
    alone: bool = False,
) -> None:  # fmt: skip
    """Make the stale stages of a target; no stage may take longer than `longest` (s).

    `alone`: make the stage `target` itself; other jobs make its inputs before.
    What the stages print goes to the run's LOG; the lines of the target and warnings are shown.
    StageError with the sentence of the stage that failed, OSError where the machine is the cause;
    RuntimeError for a defect in a stage.
    """
    check_own(run.out)
    if not alone:
        run.check(target)
    waiting = [target] if alone else list(run.stale(target))
    if "solve" in waiting:
        check_openfoam(machine.ranks)  # before any work
    if not quiet:
        for remark in run.scene.remarks():
            print(remark, flush=True)
    seconds = {stage: _expected(run, stage, machine) for stage in waiting}
    shown = targets(target) if target != "report" and not alone else []
    running: list[_Job] = []
    failed: _Job | None = None
    run.out.mkdir(parents=True, exist_ok=True)
    if waiting and not quiet:
        time_ = duration(sum(seconds.values()))
        print(f"{run.out}: about {time_}; what the stages print: {run.out / LOG}", flush=True)
    bar = tqdm(
        total=sum(seconds.values()), disable=quiet or not waiting or None,
        bar_format="{desc} {percentage:3.0f}%|{bar}| {elapsed} of about {unit}",
    )  # fmt: skip
    with bar, (run.out / LOG).open("a", encoding="utf-8") as log:

        def tell(job: _Job, line: str) -> None:
            log.write(f"{line}\n")
            log.flush()
            if not quiet and (job.stage in shown or "warning" in line):
                bar.write(line, file=sys.stdout)

        try:
            while running or (waiting and failed is None):
                for stage in waiting[:] if failed is None else ():
                    ahead = {*waiting, *(job.stage for job in running)}
                    if len(running) < machine.jobs and not ahead & {*run.inputs(stage)}:
                        waiting.remove(stage)
                        running.append(_start(run, stage, machine))
                _show(bar, running, waiting, seconds)
                _end_hung(running, longest)
                for job in _finished(running, tell):
                    running.remove(job)
                    failed = failed or (job if job.ended and job.ended[0] else None)
                    if job.stage == "kinematics" and failed is None and not alone:
                        run.check(target)  # the tip of an analysed or coupled motion in view
        except BaseException:
            for job in running:  # they clean up; Ctrl-C has reached them too
                job.process.join(_TIDY)
                if job.process.is_alive():
                    os.kill(job.process.pid or 0, signal.SIGINT)
                job.process.join(_TIDY)
                job.process.kill()  # in a library that does not return
                job.process.join()
            raise
    if failed is not None and failed.ended is not None:
        code, text = failed.ended
        if code == 130:
            raise KeyboardInterrupt
        if code == 1:
            raise RuntimeError(f"{failed.stage}: {text}")  # the child printed its traceback
        raise (OSError if code == 3 else StageError)(f"{failed.stage}: {text}")


def make_stage(run: Run, stage: str, machine: Machine, quiet: bool = False) -> None:
    """Make one stage in this process; its inputs exist. Links the files of an equal run."""
    step, begin = run.stage(stage), time.monotonic()
    check_own(run.out)
    run.out.mkdir(parents=True, exist_ok=True)
    with exclusive(run.out / f"{stage}.stage"):
        if run.why_stale(stage) is None:
            return  # another process made it meanwhile
        if (twin := run.twin(stage)) is not None:
            take_over(run, stage, twin)
            if not quiet:
                print(f"{stage}: the same as in {twin}, taken over", flush=True)
            return
        about: dict[str, Any] = {"scene": run.scene.name, "level": run.scene.level}
        about["digest"] = run.digest(stage)
        about |= {"made_from": run.made_from(stage), "versions": versions()}
        forget(run.out, stage, about["digest"])
        _check_inputs(run, step)
        earlier = _call(run, step, machine, quiet) or {}
        found = {path for name in step.outputs for path in run.out.glob(name) if path.is_file()}
        about |= _cost(time.monotonic() - begin, earlier)
        write_record(run.out, stage, about, sorted(found))
        if step.sealed:
            seal(run.out, stage)


def _check_inputs(run: Run, step: Stage) -> None:
    """StageError where a file that a stage reads is damaged, or is not this run's."""
    for name in run.inputs(step.name):
        record = read_record(run.out, name)
        if record is None or record["digest"] != run.digest(name):
            raise StageError(f"{run.path(name)}: is not of these numbers; run make again")
        for output in record["outputs"]:
            if name == "case" or not output.startswith("case/"):  # samples: where they are read
                check_whole(run.out / output)


def _call(run: Run, step: Stage, machine: Machine, quiet: bool) -> dict[str, float] | None:
    """Call a stage's function; returns the cost of interrupted runs that it resumed."""
    module, options = import_module(step.module), machine.options(step)
    if step.piv:
        (source,) = run.inputs(step.name)
        settings = _SETTINGS[step.name](run.scene)
        module.make(run.path(source), run.path(step.name), settings, quiet=quiet, **options)
        return None
    if step is FEA:
        options["output"] = run.path(FEA.name)
    spent: dict[str, float] | None = module.run(run.scene, quiet, **options)
    return spent


def _cost(wall_time: float, earlier: dict[str, float]) -> dict[str, Any]:
    """Wall and CPU time (s) and peak memory (bytes) of this process and its children."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    cpu = sum(usage.ru_utime + usage.ru_stime for usage in usages)
    return {
        "wall_time": round(earlier.get("wall_time", 0.0) + wall_time, 3),
        "cpu_time": round(earlier.get("cpu_time", 0.0) + cpu, 3),
        "peak_memory": max(usage.ru_maxrss for usage in usages) * 1024,
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _expected(run: Run, stage: str, machine: Machine) -> float:
    """Expected wall time of a stage, s."""
    step = run.stage(stage)
    processes = machine.ranks if step.ranks else machine.jobs if step.threads else 1
    return estimate(run, stage)[0] / processes


def _start(run: Run, stage: str, machine: Machine) -> _Job:
    here, there = get_context("fork").Pipe(duplex=False)
    limit = cpu_limit(run, stage)
    process = get_context("fork").Process(
        target=_child, args=(run, stage, machine, there, limit), name=stage
    )
    sys.stdout.flush()
    process.start()
    there.close()
    return _Job(stage, process, here, time.monotonic(), limit)


def cpu_limit(run: Run, stage: str) -> float:
    """CPU time (s) after which a stage counts as endless: generous, by its estimate."""
    expected = [estimate(run, stage, recorded)[0] for recorded in (True, False)]
    return max(_HOUR, _LONGEST * max(expected))


def _child(run: Run, stage: str, machine: Machine, pipe: Connection, limit: float) -> None:
    """Make a stage; sends its lines, exit code and error to the parent through `pipe`.

    The kernel ends it after `limit` s of CPU time, wherever it is.
    """
    die_with_parent()
    ends = math.ceil(limit)
    resource.setrlimit(resource.RLIMIT_CPU, (ends, ends + 1))
    sys.stdout = sys.stderr = _Lines(pipe)
    try:
        make_stage(run, stage, machine)
        pipe.send((0, ""))
    except KeyboardInterrupt:
        pipe.send((130, ""))
    except Exception as error:
        text = sentence(error)
        if text is None:
            traceback.print_exc(file=sys.__stderr__)
            pipe.send((1, one_line(error, 400)))
        else:
            pipe.send((2 if system_error(error) is None else 3, text))


class _Lines:
    """A stage's output, sent by lines to its parent; no terminal, so no progress bars."""

    encoding = "utf-8"

    def __init__(self, pipe: Connection) -> None:
        self._pipe, self._unfinished = pipe, ""

    def write(self, text: str) -> int:
        *lines, self._unfinished = (self._unfinished + printable(text)).split("\n")
        for line in lines:
            self._pipe.send(line)
        return len(text)

    def flush(self) -> None:
        """Do nothing: an unfinished line is kept until it ends."""

    def isatty(self) -> bool:
        return False


def _show(bar: tqdm, running: list[_Job], waiting: list[str], seconds: dict[str, float]) -> None:
    if bar.disable:
        return
    now = time.monotonic()
    left = sum(seconds[stage] for stage in waiting)
    left += sum(max(seconds[job.stage] - (now - job.begin), 0.0) for job in running)
    bar.n = bar.total - left
    bar.set_description_str(", ".join(job.stage for job in running), refresh=False)
    bar.unit = duration(bar.format_dict["elapsed"] + left)
    bar.refresh()


def _end_hung(running: list[_Job], longest: float) -> None:
    for job in running:
        most = min(longest, _WAITING * job.limit)
        if time.monotonic() - job.begin > most and job.ended is None:
            job.ended = (2, f"is not over after {most / 60:g} minutes")
            job.process.kill()


def _finished(running: list[_Job], tell: Callable[[_Job, str], None]) -> list[_Job]:
    """Pass on the lines of all jobs; returns the jobs that have ended."""
    done = []
    for pipe in wait([job.pipe for job in running], _TICK):
        job = next(job for job in running if job.pipe is pipe)
        try:
            while job.pipe.poll():
                message = job.pipe.recv()
                if isinstance(message, str):
                    tell(job, message)
                else:
                    job.ended = message
        except EOFError:
            job.process.join()
            code = job.process.exitcode or 0
            if job.ended is None and code == -signal.SIGXCPU:
                job.ended = (2, f"is not over after {job.limit / 60:g} minutes of CPU time; {_END}")
            elif job.ended is None:
                job.ended = (2, f"its process ended with signal {-code}; memory may be short")
            done.append(job)
    return done
