"""Full disks, folders without write permission, odd paths, no OpenFOAM, two makes at once."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

from tests.studies.faults.kill import Row, undo
from tests.studies.faults.piv_commands import piv_commands
from tests.studies.faults.project import (
    SCENE,
    TARGETS,
    command,
    compare_stages,
    complaints,
    copy_project,
    files_of,
    make,
    out_of,
    start,
)

ROOM = 12  # KiB left on a full disk: no stage's results fit
ROOM_OF_RUN = 820  # KiB: the solver reaches its time steps
HALF_OF_RUN = 2000  # KiB: and the first time that it saves them


def _outcome(
    condition: str, stage: str, done: subprocess.CompletedProcess, folder: Path, allowed: str = ""
) -> Row:
    """Ending of a stage: `refused` in one sentence and nothing else, `completed`, or `wrong`.

    An ending other than `allowed`, if that is not empty, counts as wrong.
    """
    sentences = complaints(done.stderr + done.stdout)
    if done.returncode == 0:
        ended = "completed"
    elif len(sentences) == 1:
        ended = "refused"
    else:
        ended = "wrong"
        sentences = [" | ".join((done.stderr + done.stdout).strip().splitlines()[-3:])]
    return {
        "condition": condition,
        "stage": stage,
        "ended": ended if allowed in ("", ended) else "wrong",
        "sentence": sentences[0].replace(str(folder), "…")[:300] if sentences else "",
        "afterwards": "",
    }


def _compared(stages: list[str], wanted: Path, project: Path) -> str:
    return compare_stages(stages, wanted, out_of(project)) or "as undisturbed"


def _afterwards(project: Path, wanted: Path, stage: str) -> str:
    """Result of the stage once the condition is over."""
    done = make(project, f"{SCENE}.{stage}")
    if done.returncode != 0:
        return f"does not go on: {done.stderr.strip()[-200:]}"
    return _compared([stage], wanted, project)


class _SmallDisk:
    """The scene's results on a file system of their own, with variable size and permissions."""

    def __init__(self, project: Path) -> None:
        self.out = out_of(project)
        self.aside = self.out.with_name("aside")

    def __enter__(self) -> _SmallDisk:
        os.rename(self.out, self.aside)
        self.out.mkdir()
        mount = ["mount", "-t", "tmpfs", "-o", "size=512m", "tmpfs", str(self.out)]
        done = subprocess.run(mount, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            self.out.rmdir()
            os.rename(self.aside, self.out)
            raise PermissionError(f"a file system cannot be mounted here: {done.stderr.strip()}")
        subprocess.run(["cp", "-a", f"{self.aside}/.", str(self.out)], check=True)
        return self

    def remount(self, options: str = "rw,size=512m") -> None:
        """Change the options of the mounted file system; default: room and write permission."""
        subprocess.run(["mount", "-o", f"remount,{options}", str(self.out)], check=True)

    def fill(self, room_kib: int) -> None:
        """Leave so many KiB free."""
        state = os.statvfs(self.out)
        used = (state.f_blocks - state.f_bfree) * state.f_frsize // 1024
        self.remount(f"size={used + room_kib}k")

    def __exit__(self, *_: object) -> None:
        subprocess.run(["umount", str(self.out)], check=True)
        self.out.rmdir()
        os.rename(self.aside, self.out)


def disks(project: Path, wanted: Path, folder: Path, stages: list[str]) -> Iterator[Row]:
    """A full disk and a read-only one, for every stage; a normal one afterwards."""
    disk = _SmallDisk(project)
    try:
        disk.__enter__()
    except PermissionError as error:
        row = dict.fromkeys(("stage", "sentence", "afterwards"), "")
        yield {"condition": "full or read-only disk", "ended": f"not tried: {error}", **row}
        return
    try:
        for stage in stages:
            half = sum((wanted / n).stat().st_size for n in files_of(wanted, stage)) // 2048
            full, half = (ROOM_OF_RUN, HALF_OF_RUN) if stage == "run" else (ROOM, half)
            rooms = {"disk full": full, "disk full half-way": half, "read-only folder": None}
            for condition, room in rooms.items():
                undo(project, stage)
                disk.remount("ro") if room is None else disk.fill(room)
                done = make(project, f"{SCENE}.{stage}")
                row = _outcome(condition, stage, done, folder, "refused")
                disk.remount()
                yield row | {"afterwards": _afterwards(project, wanted, stage)}
        commands = piv_commands(project, disk.fill, disk.remount) if "piv" in stages else ()
        for name, done, after in commands:
            yield _outcome("disk full", name, done, folder, "refused") | {"afterwards": after}
    finally:
        disk.__exit__()


def _solvers(project: Path, wanted: Path, folder: Path) -> Iterator[Row]:
    """No OpenFOAM, and one that is too old."""
    none, old = folder / "no-foam", folder / "old-foam"
    for path in (none, old):
        path.mkdir()
    for path in Path("/usr/bin").iterdir():
        if path.name != "pimpleFoam":
            (none / path.name).symlink_to(path)
    program = "#!/bin/sh\necho 'Using: OpenFOAM- (1806) - visit www.openfoam.com'\n"
    (old / "pimpleFoam").write_text(program)
    (old / "pimpleFoam").chmod(0o755)
    paths = {"OpenFOAM missing": str(none), "OpenFOAM too old": f"{old}:/usr/bin:/bin"}
    for condition, path in paths.items():
        undo(project, "run")
        done = make(project, f"{SCENE}.run", PATH=path, WM_PROJECT_DIR="")
        after = _afterwards(project, wanted, "run")
        yield _outcome(condition, "run", done, folder) | {"afterwards": after}
    undo(project, "run")


def _odd_paths(wanted: Path, folder: Path) -> Iterator[Row]:
    """A project in a folder with a space, which OpenFOAM cannot read, and with other letters."""
    for condition, name, allowed in (
        ("letters beyond ASCII in the path", "Größe-測定", "completed"),
        ("a space in the path", "my project", "refused"),
    ):
        project = folder / name
        if not project.exists():
            copy_project(project)
        done = make(project, f"{SCENE}.sheet")
        row = _outcome(condition, "sheet", done, folder, allowed)
        if row["ended"] == "completed":
            solved = ["kinematics", "mesh", "run", "sheet"]
            row["afterwards"] = _compared(solved, wanted, project)
        yield row
        # PIV needs no OpenFOAM: it works in any folder
        shutil.copytree(wanted, out_of(project), dirs_exist_ok=True)
        undo(project, "piv")
        done = make(project, f"{SCENE}.piv")
        row = _outcome(condition, "piv", done, folder, "completed")
        if row["ended"] == "completed":
            row["afterwards"] = _compared(["piv"], wanted, project)
        yield row


def twice(project: Path, wanted: Path, folder: Path, stages: list[str]) -> Iterator[Row]:
    """Two makes at once, of every stage by itself and of the whole chain."""
    for stage in [*stages, "all"]:
        shutil.rmtree(out_of(project)) if stage == "all" else undo(project, stage)
        target = "report" if stage == "all" else stage
        logs = [folder / f"log.make{k}" for k in (0, 1)]
        for log in logs:
            log.unlink(missing_ok=True)
        makes = [start(project, f"{SCENE}.{target}", log) for log in logs]
        codes = [process.wait() for process in makes]
        texts = [log.read_text(errors="replace") for log in logs]
        rows = [
            _outcome(
                "two makes at once",
                stage,
                subprocess.CompletedProcess(command(target), code, text, ""),
                folder,
            )
            for code, text in zip(codes, texts, strict=True)
        ]
        row = min(rows, key=lambda r: ["wrong", "refused", "completed"].index(str(r["ended"])))
        if 0 not in codes and stage != "all":  # in the chain each may have met the other once
            row["ended"] = "wrong"
        row["afterwards"] = _afterwards(project, wanted, target)
        if stage == "all":
            row["afterwards"] = _compared(TARGETS, wanted, project)
        yield row


def all_conditions(project: Path, wanted: Path, folder: Path, stages: list[str]) -> Iterator[Row]:
    """Every condition, one row each; the project is whole again after each."""
    folder = folder.resolve()
    yield from _solvers(project, wanted, folder)
    yield from disks(project, wanted, folder, stages)
    yield from _odd_paths(wanted, folder)
    yield from twice(project, wanted, folder, stages)
