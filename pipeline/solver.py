"""The solver at work on one leg: started from the last whole checkpoint, watched, stopped where it goes wrong."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

from tqdm import tqdm

from pipeline.checkpoint import drop_tables, last_checkpoint
from pipeline.errors import StageError
from pipeline.foamfile import END, write_bytes
from pipeline.frames import checkpoint_interval, time_name
from pipeline.legs import Leg
from pipeline.openfoam import die_with_parent, environment_in, last_lines, solver_command
from pipeline.scene import Numerics
from pipeline.stage import write_text

LOG = "log.pimpleFoam"
PROGRESS = "progress.json"  # what the leg has cost so far, and whether it has ended
NOTE_EVERY = 10.0  # s between notes of the time spent, for a run that is killed
BAR = "{desc}: {percentage:3.0f}%|{bar}| {n:.3f}/{total:.3f} s [{elapsed}<{remaining}]"


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


def read_progress(case: Path) -> dict[str, Any]:
    """What a leg has cost so far (`wall_time`, s), the times it was resumed at, and whether it has `ended`."""
    path = case / PROGRESS
    return json.loads(path.read_text()) if path.exists() else {"wall_time": 0.0, "resumed": []}


def set_number(case: Path, key: str, value: str) -> None:
    """Change one entry of system/numbers."""
    path = case / "system" / "numbers"
    text, count = re.subn(rf"(?m)^{key}\s.*;", f"{key:<23} {value};", path.read_text())
    if count != 1:
        raise StageError(f"{path}: entry {key!r} occurs {count} times; run the case stage again")
    write_text(path, text)


def solve(case: Path, leg: Leg, handover: float, numerics: Numerics, ranks: int, hosts: Path | None,
          bar: tqdm) -> None:  # fmt: skip
    """Run the solver to the end of a leg from its last whole checkpoint, unless it has got there before.

    `handover` is the time (s) whose fields the next leg needs: that of the last checkpoint.
    """
    record = read_progress(case)
    if record.get("ended"):
        return
    checkpoint = last_checkpoint(case, ranks)
    begin = leg.begin(numerics.time_step)
    start, name = checkpoint or (begin, time_name(begin))
    if checkpoint is not None:
        record["resumed"] = [*record["resumed"], start]
        folders = [case] if ranks == 1 else sorted(case.glob("processor*"))
        reset_displacement(folders, time_name(begin), name)
    drop_tables(case, start)
    set_number(case, "startTime", name)
    set_number(
        case, "writeInterval", f"{checkpoint_interval(handover - start, numerics.write_interval):.12g}"
    )
    clock = time.monotonic()
    noted = clock

    def note(ended: bool = False) -> None:
        spent = float(record["wall_time"]) + time.monotonic() - clock
        write_text(case / PROGRESS, json.dumps({**record, "wall_time": spent, "ended": ended}))

    guard, log = Guard(numerics.max_courant), case / LOG
    # line by line: what a kill leaves in the log is whole lines
    with open(log, "a" if checkpoint else "w", buffering=1, encoding="utf-8") as output:
        output.write("\n")  # the run before may have ended within a line
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
                    bar.update(min(guard.time, leg.end) - bar.n)
        except BaseException:
            _stop(process)
            raise
        finally:
            note()
    if process.wait() != 0:
        raise StageError(
            f"pimpleFoam failed at {guard.time:g} s (log: {log}); its last lines:\n{last_lines(log)}"
        )
    note(ended=True)


def reset_displacement(folders: list[Path], first: str, resumed: str) -> None:
    """Start a resumed run's pointDisplacement from that of the leg's first time; both are folders' names.

    It is computed anew from the frames in the first step, and v1912 cannot read back a list of values on a patch with a
    patchType ("compound has already been transferred").
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
