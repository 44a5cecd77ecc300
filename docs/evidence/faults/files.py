"""Faults of disks and files: no room, damage, and inputs of other runs."""

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from docs.evidence.faults.campaign import Campaign, Row, Work
from docs.evidence.faults.project import difference, small_run
from pipeline.runs.run import Run, targets
from pipeline.runs.stages import BY_NAME
from piv.files.record import read_record, record_path
from softfinger.make import Machine, make_stage

FULL = 12  # KiB that a full disk has left: no stage's results fit
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
