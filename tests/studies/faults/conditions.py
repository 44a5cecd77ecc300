"""Disks that are full, folders that cannot be written, odd paths, foreign files, no OpenFOAM, two makes at once."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import h5py

from tests.studies.faults.kill import undo
from tests.studies.faults.piv_commands import piv_commands
from tests.studies.faults.project import (
    PRODUCTS,
    SCENE,
    command,
    compare_stage,
    complaints,
    copy_project,
    make,
    out_of,
    start,
)

Row = dict[str, object]
ROOM = 12  # KiB that a full disk has left: no stage's results fit
ROOM_OF_RUN = 820  # KiB: the solver gets into its time steps
HALF_OF_RUN = 2000  # KiB: and to where it saves them
MADE_OF = {  # the file of an earlier stage that each stage reads first
    "mesh": "kinematics.h5",
    "case": "planform.h5",
    "run": "sweep.h5",
    "sheet": "kinematics.h5",
    "images": "sheet.h5",
    "piv": "images.h5",
    "vortices": "piv.h5",
    "compare": "sheet.h5",
    "figures": "piv.h5",
}


def outcome(condition: str, stage: str, done: subprocess.CompletedProcess, folder: Path) -> Row:
    """How a stage ended under a condition: refused in one sentence and nothing else, completed, or wrong."""
    told = complaints(done.stderr + done.stdout)
    besides = [line for line in done.stderr.splitlines() if line.strip() and line not in told]
    if done.returncode == 0:
        ended = "completed"
    elif len(told) == 1 and all(
        re.match(r"make\S*: \*\*\* .* Error [12]$", line) for line in besides
    ):
        ended = "refused"
    else:
        ended, told = "wrong", [" | ".join((done.stderr + done.stdout).strip().splitlines()[-3:])]
    sentence = told[0].replace(str(folder), "…") if told else ""
    return {
        "condition": condition,
        "stage": stage,
        "ended": ended,
        "sentence": sentence[:300],
        "afterwards": "",
    }


def afterwards(project: Path, wanted: Path, stage: str, target: str | None = None) -> str:
    """What the stage ends with once the condition is over."""
    done = make(project, f"{SCENE}.{target or stage}")
    if done.returncode != 0:
        return f"does not go on: {done.stderr.strip()[-200:]}"
    return compare_stage(stage, wanted, out_of(project)) or "as undisturbed"


class SmallDisk:
    """The scene's results on a file system of their own, whose size and permissions can be changed."""

    def __init__(self, project: Path) -> None:
        self.out = out_of(project)
        self.aside = self.out.with_name("aside")

    def __enter__(self) -> SmallDisk:
        os.rename(self.out, self.aside)
        self.out.mkdir()
        mount = ["mount", "-t", "tmpfs", "-o", "size=512m", "tmpfs", str(self.out)]
        done = subprocess.run(mount, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            self.out.rmdir()
            os.rename(self.aside, self.out)
            raise PermissionError(
                f"mounting a file system is not allowed here: {done.stderr.strip()}"
            )
        subprocess.run(["cp", "-a", f"{self.aside}/.", str(self.out)], check=True)
        return self

    def remount(self, options: str) -> None:
        """Other options for the mounted file system, such as size=1m or ro."""
        subprocess.run(["mount", "-o", f"remount,{options}", str(self.out)], check=True)

    def fill(self, room_kib: int) -> None:
        """Leave so many KiB free."""
        state = os.statvfs(self.out)
        used = (state.f_blocks - state.f_bfree) * state.f_frsize // 1024
        self.remount(f"size={used + room_kib}k")

    def empty(self) -> None:
        """Let it have room, and be written, again."""
        self.remount("rw,size=512m")

    def __exit__(self, *_: object) -> None:
        subprocess.run(["umount", str(self.out)], check=True)
        self.out.rmdir()
        os.rename(self.aside, self.out)


def half_of(stage: str, wanted: Path) -> int:
    """KiB of half of what a stage makes."""
    return sum((wanted / name).stat().st_size for name in PRODUCTS[stage]) // 2048


def disks(project: Path, wanted: Path, folder: Path, stages: list[str]) -> Iterator[Row]:
    """A full disk and a read-only one, for every stage; a normal one afterwards."""
    try:
        disk = SmallDisk(project).__enter__()
    except PermissionError as error:
        yield {"condition": "full or read-only disk", "stage": "", "ended": f"not tried: {error}", "sentence": "", "afterwards": ""}  # fmt: skip
        return
    try:
        for stage in stages:
            for condition in ("disk full", "disk full half-way", "read-only folder"):
                undo(project, stage)
                if condition == "disk full":
                    disk.fill(ROOM_OF_RUN if stage == "run" else ROOM)
                elif condition == "disk full half-way":
                    disk.fill(HALF_OF_RUN if stage == "run" else half_of(stage, wanted))
                else:
                    disk.remount("ro")
                row = outcome(condition, stage, make(project, f"{SCENE}.{stage}"), folder)
                if row["ended"] == "completed":
                    row["ended"] = "wrong"
                disk.empty()
                yield row | {"afterwards": afterwards(project, wanted, stage)}
        commands = piv_commands(project, disk.fill, disk.empty) if "piv" in stages else ()
        for name, done, after in commands:
            row = outcome("disk full", name, done, folder)
            yield row | {
                "ended": row["ended"] if row["ended"] == "refused" else "wrong",
                "afterwards": after,
            }
    finally:
        disk.__exit__()


def foreign_files(project: Path, wanted: Path, folder: Path, stages: list[str]) -> Iterator[Row]:
    """A file of an earlier stage cut to half, of another format, or no HDF5 at all."""
    out = out_of(project)
    other = folder / "other.h5"
    with h5py.File(other, "w") as file:
        file.attrs["format"] = "something else"
        file["values"] = [1.0, 2.0]
    for stage in [s for s in stages if s in MADE_OF]:
        path = out / MADE_OF[stage]
        undo(project, stage)
        whole, times = path.read_bytes(), path.stat()
        for condition, content in (
            ("half of the file before", whole[: len(whole) // 2]),
            ("foreign HDF5", other.read_bytes()),
            ("no HDF5", b"MATLAB 5.0 MAT-file" * 20),
        ):
            path.write_bytes(content)
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
            row = outcome(
                f"{condition}: {path.name}", stage, make(project, f"{SCENE}.{stage}"), folder
            )
            if row["ended"] == "completed":
                row["ended"] = "wrong"
            path.write_bytes(whole)
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
            yield row
        after = afterwards(project, wanted, stage)
        if after != "as undisturbed":
            yield row | {"afterwards": after}


def solvers(project: Path, wanted: Path, folder: Path) -> Iterator[Row]:
    """No OpenFOAM, and one that is too old."""
    undo(project, "run")
    empty, old = folder / "no-foam", folder / "old-foam"
    empty.mkdir(exist_ok=True)
    old.mkdir(exist_ok=True)
    (old / "pimpleFoam").write_text(
        "#!/bin/sh\necho 'Using: OpenFOAM- (1806) - visit www.openfoam.com'\n"
    )
    (old / "pimpleFoam").chmod(0o755)
    unset = {"WM_PROJECT_DIR": ""}
    for condition, path in (
        ("OpenFOAM missing", str(empty)),
        ("OpenFOAM too old", f"{old}:/usr/bin:/bin"),
    ):
        done = make(project, f"{SCENE}.run", PATH=path, **unset)
        yield outcome(condition, "run", done, folder) | {
            "afterwards": afterwards(project, wanted, "run")
        }
        undo(project, "run")


def odd_paths(wanted: Path, folder: Path) -> Iterator[Row]:
    """A project in a folder with a space, which OpenFOAM cannot read, and in one with other letters."""
    for condition, name, ends in (
        ("letters beyond ASCII in the path", "Größe-測定", "completed"),
        ("a space in the path", "my project", "refused"),
    ):
        project = folder / name
        if not project.exists():
            copy_project(project)
        row = outcome(condition, "sheet", make(project, f"{SCENE}.sheet"), folder)
        if row["ended"] == "completed":
            row["afterwards"] = next(
                (
                    d
                    for s in ("kinematics", "mesh", "run", "sheet")
                    if (d := compare_stage(s, wanted, out_of(project)))
                ),
                "as undisturbed",
            )
        if row["ended"] != ends:
            row["ended"] = "wrong"
        yield row
        shutil.copytree(wanted, out_of(project), dirs_exist_ok=True)
        for stage in ("piv", "vortices"):  # PIV needs no OpenFOAM: it works wherever the files are
            (out_of(project) / PRODUCTS[stage][-1]).unlink()
        images, piv = (out_of(project) / n for n in ("images.h5", "piv.h5"))
        settings = out_of(project) / "settings" / "piv.json"
        run = [".venv/bin/python", "-m", "piv", "correlate", str(images), "-o", str(piv), "--settings", str(settings), "--quiet"]  # fmt: skip
        done = subprocess.run(run, cwd=project, capture_output=True, text=True, check=False)
        row = outcome(condition, "piv", done, folder)
        if row["ended"] == "completed":
            row["afterwards"] = compare_stage("piv", wanted, out_of(project)) or "as undisturbed"
        yield row | {"ended": row["ended"] if row["ended"] == "completed" else "wrong"}


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
            outcome(
                "two makes at once",
                stage,
                subprocess.CompletedProcess(command(target), c, t, ""),
                folder,
            )
            for c, t in zip(codes, texts, strict=True)
        ]
        row = min(rows, key=lambda r: ["wrong", "refused", "completed"].index(str(r["ended"])))
        if (
            0 not in codes
        ):  # both may have met the other once; a third make must then find everything in order
            row = row | {"ended": "wrong" if stage != "all" else row["ended"]}
        row["afterwards"] = afterwards(project, wanted, target)
        if stage == "all":
            row["afterwards"] = next(
                (d for s in PRODUCTS if (d := compare_stage(s, wanted, out_of(project)))),
                "as undisturbed",
            )
        yield row


def all_conditions(project: Path, wanted: Path, folder: Path, stages: list[str]) -> Iterator[Row]:
    """Every condition, one row each; the project is whole again after each."""
    folder = folder.resolve()
    yield from solvers(project, wanted, folder)
    yield from disks(project, wanted, folder, stages)
    yield from foreign_files(project, wanted, folder, stages)
    yield from odd_paths(wanted, folder)
    yield from twice(project, wanted, folder, stages)
