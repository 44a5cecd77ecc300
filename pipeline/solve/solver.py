"""The solver of one mesh interval: started from the last checkpoint, stopped by a guard."""

import json
import os
import re
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tqdm import tqdm

from pipeline.formats.mesh_intervals import Interval
from pipeline.openfoam.displacement_files import time_name
from pipeline.openfoam.environment import (
    die_with_parent,
    environment_in,
    last_lines,
    solver_command,
)
from pipeline.openfoam.foamfile import END, set_number, write_bytes
from pipeline.openfoam.ranks import Ranks
from pipeline.solve.checkpoint import (
    LOG,
    drop_tables,
    first_damaged,
    force_times,
    last_checkpoint,
    reached_time,
)
from pipeline.solve.coupled import Follower
from pipeline.solve.guards import FINER, Guard
from piv.files.atomic import check_room, name_in_errors, sync_file, write_text
from piv.files.errors import StageError
from piv.files.json_text import read_json

PROGRESS = "progress.json"  # cost of the interval so far, and whether it has ended
_OUTSIDE = signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGXCPU
_NOTE_EVERY = 10.0  # s between updates of the cost, for a run that is killed
_SILENCE = 900.0  # s without a line from the solver
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
        """The solver has written a line."""
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


def read_progress(case: Path) -> dict[str, Any]:
    """Cost of an interval (`wall_time`, `cpu_time`, s), times of its resumptions, whether `ended`.

    StageError where the file is damaged.
    """
    path = case / PROGRESS
    remedy = (
        "delete it and run make again: the solver resumes from its last checkpoint, its cost counts"
        " from there"
    )
    known = read_json(path, remedy) if path.exists() else {}
    return {"wall_time": 0.0, "cpu_time": 0.0, "resumed": []} | known


def has_ended(case: Path, interval: Interval) -> bool:
    """Whether an interval was solved to its end and all its sampled surfaces are there."""
    return bool(read_progress(case).get("ended")) and first_damaged(case) > interval.end


def resumes_rightly(version: str, kind: str, pinch: bool, moving: bool) -> bool:
    """Whether a resumed run ends as an undisturbed one.

    Versions after v1912 lose the checkpoint's mesh flux where a symmetry plane needs the geometry
    first (docs/openfoam_versions.md); in 2-D only a pinch has one.
    """
    return version == "v1912" or not moving or (kind == "2d" and not pinch)


def solve(
    case: Path,
    interval: Interval,
    ranks: Ranks,
    hosts: Path | None,
    bar: tqdm,
    guard: Guard,
    resumes: bool = True,
    follower: Follower | None = None,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Run the solver to the end of an interval, unless it has ended; its progress before and now.

    `follower`: of a coupled run, gives the motion of each next step.

    It starts from the last whole checkpoint, or from the beginning where this OpenFOAM cannot
    resume (not `resumes`). StageError where `guard` stops it, it fails, or its samples for a guard
    of the energy end before the interval; its files are kept.
    """
    record = read_progress(case)
    if has_ended(case, interval):
        return record, record
    checkpoint = last_checkpoint(case, ranks, interval.moving) if resumes else None
    first = time_name(interval.begin)
    start, name = checkpoint or (interval.begin, first)
    if checkpoint is not None:
        record["resumed"] = [*record["resumed"], start]
        if interval.moving:
            _reset_displacement(ranks.folders(case), first, name)
    guard.time = start
    drop_tables(case, start)
    set_number(case, "startTime", reached_time(case, ranks, name) if checkpoint else name)
    if follower:
        follower.begin(start)
    clock = time.monotonic()
    noted = clock
    cpu = 0.0  # s of all ranks

    def note(ended: bool = False) -> dict[str, Any]:
        now = {
            **record,
            "wall_time": record["wall_time"] + time.monotonic() - clock,
            "cpu_time": record["cpu_time"] + cpu,
            "ended": ended,
        }
        write_text(case / PROGRESS, json.dumps(now))
        return now

    if guard.energy and (interval.index or checkpoint):
        guard.energy.from_rest = False
    log = case / LOG

    def stopped(cause: str) -> StageError:
        return StageError(
            f"stopped at {guard.time:g} s by a guard: {cause}; the fields are kept in {case}:"
            f" {guard.remedy}"
        )

    # line by line: a kill leaves whole lines in the log
    with (
        name_in_errors(log),
        open(log, "a" if checkpoint else "w", buffering=1, encoding="utf-8") as output,
    ):
        output.write("\n")  # the run before may have ended within a line
        process = subprocess.Popen(
            solver_command(ranks.count, hosts),
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
        with Watchdog(_SILENCE, lambda: _stop(process)) as watchdog:
            try:
                for line in process.stdout:
                    output.write(line)
                    watchdog.reset()
                    cause = guard.verdict(line)
                    if cause:
                        raise stopped(cause)
                    if line.startswith("ExecutionTime"):
                        cpu = ranks.count * float(line.split()[2])
                        if follower:
                            follower.answer(guard.time, lambda: process.poll() is None)
                    if line.startswith("Time = "):
                        if time.monotonic() - noted > _NOTE_EVERY:
                            noted = time.monotonic()
                            note()
                        bar.update(min(guard.time, interval.end) - bar.n)
            except BaseException:
                _stop(process)
                raise
            finally:
                if follower:
                    follower.end()
                note()
    code = process.wait()
    if watchdog.cause:
        guard.remedy = "check the machine and numerics, then run make again to resume"
        raise stopped(watchdog.cause)
    if code != 0:
        raise failed(case, guard.time, code)
    # a flow without a body has no samples and no guard of the energy (docs/evidence/validation)
    sampled = force_times(case)[-1] * (1 + 1e-6) if guard.energy else interval.end
    until = min(sampled, damaged := first_damaged(case))
    if until < interval.end or damaged <= interval.end:
        check_room(case)
        raise StageError(
            f"{case / 'postProcessing'}: the solver's samples are cut off at {until:g} s, as by a"
            " full disk; run make again: it resumes before that time"
        )
    if cause := guard.check_energy(ended=True):
        raise stopped(cause)
    for table in [log, *(case / "postProcessing").glob("*/*/*.dat")]:
        # a power cut must not shorten these files once the interval has ended
        sync_file(table)
    return record, note(ended=True)


def failed(case: Path, reached: float, code: int) -> StageError:
    """The error for a solver that ended with an exit `code`; OSError where its disk is full."""
    check_room(case)
    log = case / LOG
    tail = last_lines(log)
    if re.search(r"Floating point exception|sigFpe|SIGFPE|signal 8", tail):
        return StageError(
            f"stopped at {reached:g} s: the solver's numbers overflowed; the fields are kept in"
            f" {case}: {FINER}"
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
