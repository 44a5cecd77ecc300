"""Faults of the machine and of files in every stage of a small run, and what came of each.

A fault either leaves a stage complete or is refused in one sentence; afterwards the run ends as an
undisturbed one.
"""

import contextlib
import os
import random
import shutil
import signal
import time
from collections.abc import Callable
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from docs.evidence.faults.project import difference, small_run
from pipeline.runs.run import Run
from pipeline.runs.stages import STAGES
from piv.files.errors import sentence
from softfinger.make import Machine, make

TARGETS = list(dict.fromkeys(stage.group or stage.name for stage in STAGES))  # in order
COLUMNS = ("stage", "fault", "times", "completed", "refused", "recomputed", "wrong", "sentence")
LONGEST = 1800.0  # s of a stage, on a busy machine
Row = dict[str, Any]
Answer = tuple[int, str]  # 0: completed, 2: refused in one sentence, 1: in another way; the text


class Work:
    """An action in a process group of its own; `answer` waits for it."""

    def __init__(self, action: Callable[[], Any], **env: str) -> None:
        self._pipe, there = get_context("fork").Pipe(duplex=False)
        self._process = get_context("fork").Process(target=self._child, args=(action, there, env))
        self._process.start()
        there.close()

    @staticmethod
    def _child(action: Callable[[], Any], pipe: Any, env: dict[str, str]) -> None:
        os.setsid()
        os.environ.update(env)
        try:
            text = action()
            pipe.send((0, text or ""))
        except BaseException as error:
            text = sentence(error)
            good = text is not None and "\n" not in text.strip()
            pipe.send((2, text) if good else (1, repr(error)))

    def running(self) -> bool:
        return self._process.is_alive()

    def kill(self) -> None:
        """kill -9 of all its processes; the solver, in its own session, must end by itself."""
        with contextlib.suppress(ProcessLookupError):  # no group yet: it has started nothing
            os.killpg(self._process.pid or 0, signal.SIGKILL)
        self._process.kill()
        self._process.join()

    def answer(self) -> Answer:
        if not self._pipe.poll(LONGEST):
            self.kill()
            return 1, f"not over after {LONGEST:g} s"
        answer = self._pipe.recv()
        self._process.join()
        return answer


class Campaign:
    """An undisturbed run of a small scene in `folder`, its state before each target, and `out`."""

    def __init__(self, folder: Path, until: str = TARGETS[-1], coupled: bool = False) -> None:
        self.folder = folder
        self.run = small_run(folder / "small", coupled=coupled)
        self.out, self.wanted = self.run.out, folder / "wanted"
        self.chosen = TARGETS[: TARGETS.index(until) + 1]
        self.seconds: dict[str, float] = {}
        self.out.mkdir(parents=True, exist_ok=True)
        for target in self.chosen:
            shutil.copytree(self.out, folder / "before" / target, symlinks=True)
            begin = time.monotonic()
            code, text = self.make(target).answer()
            assert code == 0, text
            self.seconds[target] = time.monotonic() - begin
        shutil.copytree(self.out, self.wanted)

    def make(self, target: str, run: Run | None = None, **env: str) -> Work:
        return Work(partial(make, run or self.run, target, Machine(), quiet=True), **env)

    def restore(self, source: Path) -> None:
        """Put the files of `source` in place of the results."""
        for path in self.out.iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        shutil.copytree(source, self.out, dirs_exist_ok=True)

    def before(self, target: str) -> None:
        """Put back the results as they were before a target was made."""
        self.restore(self.folder / "before" / target)

    def again(self, target: str) -> str:
        """What is wrong after one more make; empty where it ends as the undisturbed one."""
        code, text = self.make(target).answer()
        if code:
            return f"does not go on: {text}"
        left = ", ".join(path.name for path in self.out.rglob("*.part"))
        return difference(self.wanted, self.out, [target]) or (left and f"{left} left behind")

    def row(
        self, stage: str, fault: str, answers: list[Answer], wrong: str = "", **more: int
    ) -> Row:
        """A row of the table: `wrong` counts as one more answer in another way."""
        codes = [code for code, _ in answers]
        bad_first = sorted(answers, key=lambda answer: answer[0] != 1)
        texts = [wrong, *(text for _, text in bad_first)]
        return {
            "stage": stage, "fault": fault, "times": len(answers), "completed": codes.count(0),
            "refused": codes.count(2), "recomputed": 0, "wrong": codes.count(1) + bool(wrong),
            "sentence": next(filter(None, texts), "").replace(f"{self.folder}/", "")[:300],
        } | more  # fmt: skip


def kills(at: Campaign, target: str, count: int, seed: int) -> Row:
    """Kill a target `count` times, one to three times in succession, and let it end."""
    draw, killed, compared, attempts = random.Random(f"{seed}{target}"), 0, 0, 0
    duration, wrong = at.seconds[target], ""
    while killed < count and attempts < 5 * count and not wrong:
        at.before(target)
        for _ in range(min(draw.choice((1, 2, 3)), count - killed)):
            attempts += 1
            begun, work = time.monotonic(), at.make(target)
            _wait(at.out, work, draw, duration)
            if not work.running():  # it ended before
                duration = min(duration, time.monotonic() - begun)
                at.before(target)
                continue
            work.kill()
            killed += 1
            wrong = wrong or _solver_lives(at.out)
        wrong = wrong or at.again(target)
        compared += 1
    return at.row(target, "killed", [], wrong, times=killed, completed=compared - bool(wrong))


def _wait(out: Path, work: Work, draw: random.Random, duration: float) -> None:
    """Wait for any moment of the work, or until it begins to write and a little longer."""
    begun, end = time.time(), time.monotonic() + draw.uniform(0, duration)
    writing = draw.random() < 0.5
    while work.running() and (writing or time.monotonic() < end):
        if writing and _newest(out) > begun:
            time.sleep(draw.uniform(0, 0.1 * duration))
            return
        time.sleep(0.005)


def _newest(out: Path) -> float:
    """Time of the last write of a file in a folder."""
    times = [0.0]
    for folder, _, names in os.walk(out):
        for name in names:
            if not name.endswith(".lock"):
                with contextlib.suppress(OSError):  # files vanish meanwhile
                    times.append(os.stat(f"{folder}/{name}").st_mtime)
    return max(times)


def _solver_lives(out: Path, patience: float = 20.0) -> str:
    """Says so where a solver still works in the folder after `patience` s."""
    deadline = time.monotonic() + patience
    while any(_solves(path, out) for path in Path("/proc").glob("[0-9]*")):
        if time.monotonic() > deadline:
            return "a solver lives on"
        time.sleep(0.1)
    return ""


def _solves(process: Path, out: Path) -> bool:
    try:
        zombie = (process / "stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
        solver = (process / "comm").read_text().strip() == "pimpleFoam"
        return solver and not zombie and Path(os.readlink(process / "cwd")).is_relative_to(out)
    except OSError:
        return False


def twice(at: Campaign, target: str) -> Row:
    """Two makes of a target at once."""
    at.before(target)
    works = [at.make(target) for _ in range(2)]
    answers = [work.answer() for work in works]
    none = "" if 0 in dict(answers) else "none completed"
    return at.row(target, "two makes at once", answers, none or at.again(target))
