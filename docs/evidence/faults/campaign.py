"""Faults of the machine and of files in every stage of a small run, and what came of each.

A fault either leaves a stage complete or is refused in one sentence; afterwards the run ends as an
undisturbed one.
"""

import contextlib
import os
import random
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import chain
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from docs.evidence.faults.project import difference, small_run
from pipeline.runs.run import Run, targets
from pipeline.runs.stages import BY_NAME, STAGES
from piv.files.errors import sentence
from piv.files.record import read_record, record_path
from softfinger.make import Machine, make, make_stage

TARGETS = list(dict.fromkeys(stage.group or stage.name for stage in STAGES))  # in order
COLUMNS = ("stage", "fault", "times", "completed", "refused", "recomputed", "wrong", "sentence")
FULL = 12  # KiB that a full disk has left: no stage's results fit
LONGEST = 1800.0  # s of a stage, on a busy machine
COUPLED_RUN = "solve, coupled"
Row = dict[str, Any]
Answer = tuple[int, str]  # 0: completed, 2: refused in one sentence, 1: in another way; the text
READ = {  # files of earlier stages than those that a stage names as its inputs
    "case": ("kinematics.h5",), "solve": ("kinematics.h5", "planform.h5", "mesh_quality.csv"),
    "sheet": ("kinematics.h5", "planform.h5"), "loads": ("kinematics.h5", "planform.h5"),
}  # fmt: skip


WAYS: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda content: b"",
    "cut in half": lambda content: content[: len(content) // 2],
    "its first 20 bytes": lambda content: content[:20],
    "last byte missing": lambda content: content[:-1],
    "first byte missing": lambda content: content[1:],
    "a line more": lambda content: content + b"99\n",
    "a bit flipped": lambda c: _put(c, len(c) // 2, bytes([c[len(c) // 2] ^ 1])),
    "a block of zeros": lambda c: _put(c, len(c) // 3, bytes(len(c) // 9 + 1)),
    "zeros": lambda content: bytes(len(content)),
    "halves exchanged": lambda content: content[len(content) // 2 :] + content[: len(content) // 2],
    "noise": lambda content: np.random.default_rng(1).bytes(len(content)),
    "another format": lambda content: b"no such thing\n" * 9,
}


def _put(content: bytes, at: int, part: bytes) -> bytes:
    return content[:at] + part + content[at + len(part) :]


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


@contextmanager
def small_disk(at: Campaign) -> Iterator[Callable[[str], None]]:
    """The results on a file system of their own; yields a function that changes its options.

    PermissionError where none can be mounted.
    """
    mount = ["mount", "-t", "tmpfs", "-o", "size=512m", "tmpfs", str(at.out)]
    done = subprocess.run(mount, capture_output=True, text=True, check=False)
    if done.returncode:
        raise PermissionError(f"a file system cannot be mounted here: {done.stderr.strip()}")

    def remount(options: str) -> None:
        subprocess.run(["mount", "-o", f"remount,{options}", str(at.out)], check=True)

    try:
        yield remount
    finally:
        subprocess.run(["umount", str(at.out)], check=True)


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _room(out: Path, kib: int) -> str:
    """The option of a disk with so many KiB left."""
    state = os.statvfs(out)
    return f"size={(state.f_blocks - state.f_bfree) * state.f_frsize // 1024 + kib}k"


def disks(at: Campaign, chosen: list[str]) -> Iterator[Row]:
    """A full disk, one that becomes full half-way, and a read-only one; with room afterwards."""
    with small_disk(at) as remount:
        for target in chosen:
            at.before(target)
            states = [*(at.folder / "before" / name for name in at.chosen), at.wanted]
            began, ended = (_size(states[at.chosen.index(target) + k]) for k in (0, 1))
            half = (ended - began) // 2048
            for fault, room in (("full", FULL), ("full half-way", half), ("read-only", None)):
                at.before(target)
                remount("ro" if room is None else _room(at.out, room))
                answer = at.make(target).answer()
                remount("rw,size=512m")
                wrong = "" if answer[0] else "completed without room"
                yield at.row(target, f"disk {fault}", [answer], wrong or at.again(target))


def damaged(at: Campaign, target: str) -> Iterator[Row]:
    """Each input of a target in twelve ways, its size and time kept where they can be."""
    for step in map(BY_NAME.__getitem__, targets(target)):
        at.restore(at.wanted)
        for path in _inputs(at.run, step.name):
            works = (Work(partial(_damaged, at.run, step.name, path, way)) for way in WAYS)
            answers = [work.answer() for work in works]
            named = [(c if str(path) in t else 1, t) for c, t in answers]
            yield at.row(step.name, f"damaged {path.relative_to(at.out)}", named)


def _damaged(run: Run, stage: str, path: Path, way: str) -> str:
    """Make a stage with a damaged input, of which the stages before it do not know."""
    content, state = path.read_bytes(), path.stat()
    record = record_path(run.out, stage)
    kept = record.read_bytes()
    record.unlink()
    try:
        path.write_bytes(WAYS[way](content))
        os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
        make_stage(run, stage, Machine(), quiet=True)
    finally:
        path.write_bytes(content)
        os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
        record.write_bytes(kept)
    raise RuntimeError(f"{way}: it was used")


def _inputs(run: Run, stage: str) -> list[Path]:
    """The files that a stage reads of the stages before it."""
    step = BY_NAME[stage]
    if step.inputs == ("solve",):  # they read the samples alone
        name = {"sheet": "sheetSurface", "loads": "fingerSurface"}[stage]
        surface = max(run.out.glob(f"case/interval_0/postProcessing/{name}/*/*.vtk"))
        return [surface, *(run.out / n for n in READ[stage])]
    files = [run.path(name) for name in step.inputs] + [run.out / n for n in READ.get(stage, ())]
    if stage == "solve":
        record = read_record(run.out, "case")
        assert record is not None
        files += [run.out / name for name in record["outputs"] if name.startswith("case/")]
    return files


def swapped(
    at: Campaign, source: Path, name: str, stages: list[str], chosen: list[str]
) -> Iterator[Row]:
    """The results of stages, with their record, replaced by those of a run in `source`.

    `chosen`: the stages that read them.
    """
    for step in map(BY_NAME.__getitem__, stages):
        readers = [n for n in chosen if step.name in BY_NAME[n].inputs]
        at.restore(at.wanted)
        record = read_record(source, step.name)
        assert record is not None
        for part in (*record["outputs"], record_path(Path(), step.name)):
            shutil.copy2(source / part, at.out / part)
        for reader in readers:  # each must be made anew, from the input that it finds
            record_path(at.out, reader).unlink()
        unseen = [reader for reader in readers if step.name not in at.run.stale(reader)]
        for reader in readers:
            code, text = at.make(BY_NAME[reader].group or reader).answer()
            wrong = "the foreign input counts as its own" if reader in unseen else text * (code > 0)
            wrong = wrong or difference(at.wanted, at.out, [BY_NAME[reader].group or reader])
            fault = f"{step.name} of {name}"
            yield at.row(reader, fault, [], wrong, times=1, recomputed=int(not wrong))


def odd_paths(at: Campaign) -> Iterator[Row]:
    """Folders whose names OpenFOAM, or a console, cannot write."""
    for fault, name in (
        ("letters beyond ASCII in the path", "Größe-測定"),
        ("spaces and quotes in the path", "o'brien's \"lab\""),
    ):
        run = small_run(at.folder / name / "small")
        answer = at.make("sheet", run).answer()
        wrong = "" if answer[0] == 0 else f"ended with {answer[0]}"
        yield at.row("sheet", fault, [answer], wrong or difference(at.wanted, run.out, ["sheet"]))


def of_kills(at: Campaign, chosen: list[str], count: int, seed: int) -> Iterator[Row]:
    """Kill each target, a coupled run too, and make each twice at once."""
    for target in chosen:
        yield kills(at, target, count, seed)
        yield twice(at, target)
    if "solve" in chosen:
        coupled = Campaign(at.folder / "coupled", "solve", coupled=True)
        yield kills(coupled, "solve", 2 * count, seed) | {"stage": COUPLED_RUN}


def foreign(at: Campaign, chosen: list[str]) -> Iterator[Row]:
    """Replace the inputs of targets by those of other runs, with their records."""
    readers = [stage for target in chosen for stage in targets(target)]
    read = [name for name in BY_NAME if any(name in BY_NAME[r].inputs for r in readers)]
    for name, run in (
        ("another scene", small_run(at.folder / "other" / "small", pressure=14.0)),
        ("another level", small_run(at.folder / "small", "other")),
    ):
        code, text = at.make(at.chosen[-1], run).answer()
        assert code == 0, text
        yield from swapped(at, run.out, name, read, readers)


# by name: the rows of each part of the campaign, and what it does to some targets
PARTS: dict[str, tuple[str, Callable[[Campaign, list[str], int, int], Iterator[Row]]]] = {
    "kills": ("killed|two makes at once", of_kills),
    "paths": (".* in the path", lambda at, *_: odd_paths(at)),
    "disks": ("disk .*", lambda at, chosen, *_: disks(at, chosen)),
    "damaged": ("damaged .*", lambda at, chosen, *_: chain(*(damaged(at, t) for t in chosen))),
    "foreign": (".* of another .*", lambda at, chosen, *_: foreign(at, chosen)),
}


def replaced(old: pd.DataFrame, parts: list[str], chosen: list[str]) -> pd.DataFrame:
    """The rows of an earlier table that these parts on these targets do not make anew."""
    stages = {stage for target in TARGETS for stage in (target, *targets(target))}
    anew = {stage for target in chosen for stage in (target, *targets(target))}
    anew |= {COUPLED_RUN} if "solve" in chosen else set()
    fault, stage = old["fault"], old["stage"]
    made = [fault.str.fullmatch(PARTS[part][0]) & (stage.isin(anew) | (part == "paths"))
            for part in parts]  # fmt: skip
    return old[stage.isin(stages | {COUPLED_RUN}) & ~np.logical_or.reduce(made)]
