"""The solver, interval by interval: started from the last checkpoint, stopped by a guard."""

import json
import os
import re
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from tqdm import tqdm

from pipeline.case.interval_case import write_numbers
from pipeline.openfoam.displacement_files import time_name
from pipeline.openfoam.environment import (
    die_with_parent,
    environment,
    foam_version,
    last_lines,
    solver_command,
)
from pipeline.openfoam.foamfile import END, set_number, write_bytes
from pipeline.scene.scene import Scene
from pipeline.solve.checkpoint import (
    LOG,
    PROGRESS,
    drop_tables,
    first_damaged,
    force_times,
    has_ended,
    last_checkpoint,
    reached_time,
    read_progress,
)
from pipeline.solve.guards import FINER
from pipeline.solve.interval import KnownMotion, SolverInterval
from pipeline.solve.lead import solve_lead
from pipeline.solve.prepare import prepare
from piv.files.atomic import check_room, name_in_errors, sync_file, write_text
from piv.files.errors import StageError

_OUTSIDE = signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGXCPU
_NOTE_EVERY = 10.0  # s between updates of the cost, for a run that is killed
_SILENCE = 900.0  # s without a line from the solver
Progress = tuple[dict[str, Any], dict[str, Any]]  # of an interval, before and now
BAR = "{desc}: {percentage:3.0f}%|{bar}| {n:.3f}/{total:.3f} s [{elapsed}<{remaining}]"


class Watchdog:
    """Calls `stop` once when the solver is silent for `limit` s; `cause` names the reason.

    Only time of an awake machine counts.
    """

    TICK = 5.0  # s

    def __init__(self, limit: float, stop: Callable[[], None]) -> None:
        self.limit, self.stop = limit, stop
        self.cause: str | None = None
        self._quiet = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def reset(self) -> None:
        """Count the silence from now: the solver has written a line."""
        self._quiet = 0.0

    def _watch(self) -> None:
        tick = min(self.TICK, self.limit / 4)
        while not self._over.wait(tick):
            self._quiet += tick
            if self._quiet > self.limit:
                self.cause = f"the solver has written nothing for {self.limit / 60:g} minutes"
                self.stop()
                return

    def __enter__(self) -> "Watchdog":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()


def resumes_rightly(version: str, kind: str, pinch: bool, moving: bool) -> bool:
    """Whether a resumed run ends as an undisturbed one.

    Versions after v1912 lose the checkpoint's mesh flux where a symmetry plane needs the geometry
    first (docs/openfoam_versions.md); in 2-D only a pinch has one.
    """
    return version == "v1912" or not moving or (kind == "2d" and not pinch)


def solve_intervals(
    scene: Scene,
    parts: list[SolverInterval],
    motion_of: Callable[[SolverInterval], KnownMotion],
    hosts: Path | None,
    quiet: bool,
) -> list[Progress]:
    """Solve the intervals one after the other; the progress of each before and now.

    `motion_of` may change a part's mesh, where its motion is found while it is solved.
    """
    hosts = hosts and hosts.resolve()  # the solver runs in another folder
    version, spans = foam_version(), [part.span for part in parts]
    spent = solve_lead(scene, parts[0], partial(solve, hosts=hosts), quiet)
    with tqdm(total=scene.motion.end_time, unit="s", disable=quiet or None, desc="solver",
              bar_format=BAR) as bar:  # fmt: skip
        for k, part in enumerate(parts):
            motion = motion_of(part)
            # what was edited by hand, and the start of an earlier solver
            write_numbers(scene, spans, spans[k], part.mesh.planform)
            prepare(parts, k, motion, quiet)
            pinch, moving = scene.pinch is not None, spans[k].moving
            rightly = resumes_rightly(version, scene.model.kind, pinch, moving)
            spent.append(solve(part, motion, bar, hosts, rightly))
            motion.finish()
            bar.update(spans[k].end - bar.n)
    return spent


def solve(
    part: SolverInterval,
    motion: KnownMotion,
    bar: tqdm,
    hosts: Path | None = None,
    resumes: bool = True,
) -> Progress:
    """Run the solver to the end of an interval, unless it has ended; its progress before and now.

    It starts from the last whole checkpoint, or from the beginning where this OpenFOAM cannot
    resume (not `resumes`). StageError where `guard` stops it, it fails, or its samples for a guard
    of the energy end before the interval; its files are kept.
    """
    interval, guard, folder = part.span, part.guard, part.case.folder
    record = read_progress(folder)
    if has_ended(folder, interval):
        return record, record
    checkpoint = last_checkpoint(part.case, interval.moving) if resumes else None
    if checkpoint is not None:
        record["resumed"] = [*record["resumed"], checkpoint[0]]
    motion.begin(_start_at(part, checkpoint))
    clock = _Clock(folder, record)
    log = folder / LOG
    # line by line: a kill leaves whole lines in the log
    with (
        name_in_errors(log),
        open(log, "a" if checkpoint else "w", buffering=1, encoding="utf-8") as output,
    ):
        output.write("\n")  # the run before may have ended within a line
        process = subprocess.Popen(
            solver_command(folder, part.case.ranks, hosts),
            cwd=folder,
            env=environment(),
            preexec_fn=die_with_parent,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            bufsize=1,
            start_new_session=True,
        )
        with Watchdog(_SILENCE, lambda: _stop(process)) as watchdog:
            try:
                _follow(process, part, motion, bar, clock, output, watchdog)
            except BaseException:
                _stop(process)
                raise
            finally:
                motion.end()
                clock.note()
    code = process.wait()
    if watchdog.cause:
        guard.remedy = "check the machine and numerics, then run make again to resume"
        raise _stopped(part, watchdog.cause)
    if code != 0:
        raise failed(folder, guard.time, code)
    _check_samples(part)
    for table in [log, *(folder / "postProcessing").glob("*/*/*.dat")]:
        # a power cut must not shorten these files once the interval has ended
        sync_file(table)
    return record, clock.note(ended=True)


def _start_at(part: SolverInterval, checkpoint: tuple[float, str] | None) -> float:
    """Prepare the case to start at a checkpoint, or at the interval's begin; returns the time."""
    folder, interval = part.case.folder, part.span
    first = time_name(interval.begin)
    start, name = checkpoint or (interval.begin, first)
    if checkpoint is not None and interval.moving:
        _reset_displacement(part.case.folders, first, name)
    part.guard.time = start
    if part.guard.energy and (interval.index or checkpoint):
        part.guard.energy.from_rest = False
    drop_tables(folder, start)
    set_number(folder, "startTime", reached_time(part.case, name) if checkpoint else name)
    return start


class _Clock:
    """Writes the cost of an interval beside its case, that of earlier runs included."""

    def __init__(self, folder: Path, record: dict[str, Any]) -> None:
        self.cpu = 0.0  # s of all ranks
        self._folder, self._record = folder, record
        self._begun = self._noted = time.monotonic()

    def note(self, ended: bool = False) -> dict[str, Any]:
        """Write the cost so far."""
        self._noted = time.monotonic()
        now = {
            **self._record,
            "wall_time": self._record["wall_time"] + self._noted - self._begun,
            "cpu_time": self._record["cpu_time"] + self.cpu,
            "ended": ended,
        }
        write_text(self._folder / PROGRESS, json.dumps(now))
        return now

    def tick(self) -> None:
        """Write the cost so far, now and then."""
        if time.monotonic() - self._noted > _NOTE_EVERY:
            self.note()


def _follow(
    process: subprocess.Popen[str],
    part: SolverInterval,
    motion: KnownMotion,
    bar: tqdm,
    clock: _Clock,
    output: TextIO,
    watchdog: Watchdog,
) -> None:
    """Read the solver's lines to their end: guard it, answer its steps, and keep its log."""
    guard = part.guard
    assert process.stdout is not None
    for line in process.stdout:
        output.write(line)
        watchdog.reset()
        if cause := guard.verdict(line):
            raise _stopped(part, cause)
        if line.startswith("ExecutionTime"):
            clock.cpu = part.case.ranks * float(line.split()[2])
            motion.answer(guard.time, lambda: process.poll() is None)
        if line.startswith("Time = "):
            clock.tick()
            bar.update(min(guard.time, part.span.end) - bar.n)


def _check_samples(part: SolverInterval) -> None:
    """StageError where the samples end before the interval, or the energy does not add up."""
    folder, guard, end = part.case.folder, part.guard, part.span.end
    # a flow without a body has no samples and no guard of the energy (docs/evidence/validation)
    sampled = force_times(folder)[-1] * (1 + 1e-6) if guard.energy else end
    until = min(sampled, damaged := first_damaged(folder))
    if until < end or damaged <= end:
        check_room(folder)
        raise StageError(
            f"{folder / 'postProcessing'}: the solver's samples are cut off at {until:g} s, as by a"
            " full disk; run make again: it resumes before that time"
        )
    if cause := guard.check_energy(ended=True):
        raise _stopped(part, cause)


def _stopped(part: SolverInterval, cause: str) -> StageError:
    """The error for a solver that a guard has stopped."""
    return StageError(
        f"stopped at {part.guard.time:g} s by a guard: {cause}; the fields are kept in"
        f" {part.case.folder}: {part.guard.remedy}"
    )


def failed(folder: Path, reached: float, code: int) -> StageError:
    """The error for a solver that ended with an exit `code`; OSError where its disk is full."""
    check_room(folder)
    log = folder / LOG
    tail = last_lines(log)
    if re.search(r"Floating point exception|sigFpe|SIGFPE|signal 8", tail):
        return StageError(
            f"stopped at {reached:g} s: the solver's numbers overflowed; the fields are kept in"
            f" {folder}: {FINER}"
        )
    rank = re.search(r"exited on signal (\d+)", tail)
    number = -code if code < 0 else int(rank[1]) if rank else code - 128
    if number in _OUTSIDE:
        memory = ", as where the memory is used up" if number == signal.SIGKILL else ""
        return StageError(
            f"pimpleFoam was killed at {reached:g} s by {signal.Signals(number).name}{memory};"
            " run make again: it resumes from its last checkpoint"
        )
    return StageError(f"pimpleFoam failed at {reached:g} s (log: {log}); its last lines:\n{tail}")


def _reset_displacement(folders: list[Path], first: str, resumed: str) -> None:
    """Start a resumed run's pointDisplacement from that of the interval's first time's folder.

    The first step computes it anew from the frames, and v1912 cannot read a list of values on a
    patch with a patchType.
    """
    for folder in folders:
        content = (folder / first / "pointDisplacement").read_bytes().rstrip()
        if not content.endswith(END.strip()):
            content += END  # a whole file, for the next resumption
        write_bytes(folder / resumed / "pointDisplacement", content)


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
