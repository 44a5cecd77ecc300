"""A small copy of the project for faults: a scene of a few hundred cells, with all its stages."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import h5py
import numpy as np

from fileio.record import read_record
from pipeline.runs.run import targets
from pipeline.runs.stages import STAGES
from tests.inner_make import inner_environment

ROOT = Path(__file__).resolve().parents[3]
FILES = ("Makefile", "requirements.lock", "pyproject.toml")
FOLDERS = ("cases", "fileio", "pipeline", "piv", "postprocess")
SCENE, LEVEL = "small", "tiny"

SMALL = """# A stroke of 60 ms in 2-D on a coarse mesh: every stage takes seconds.
extends = "../single_finger"
title = "Small"
[motion]
strokes = [{ pressure_kpa = 12.0, start = 0.002, duration = 0.05 }]
end_time = 0.06
[levels.tiny]
model = { kind = "2d" }
numerics = { time_step = 1e-3, write_interval = 0.01, non_orthogonal_correctors = 0 }
sheet = { spacing = 2e-3 }
camera = { columns = 320, rows = 256, centre = [0.01, 0.185], truth = true }
piv = { every = 2, preset = "fast" }
[levels.tiny.mesh]
wall_cell = 3.5e-3
wall_first_layer = 1.2e-3
wall_layers = 2
tip_cell = 2.2e-3
near_cell = 5e-3
near_distance = 0.01
far_cell = 0.05
"""

TARGETS = list(dict.fromkeys(stage.group or stage.name for stage in STAGES))  # of make, in order
SPENT = ("wall_time", "resumed")  # numbers of a run that a resumed one does not repeat


def copy_project(folder: Path) -> Path:
    """Copy the project without results, link this environment, add the small scene."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in FILES:
        shutil.copy2(ROOT / name, folder / name)
    for name in FOLDERS:  # with what numba has compiled
        shutil.copytree(
            ROOT / name, folder / name, ignore=shutil.ignore_patterns("out", ".snakemake")
        )
    (folder / ".venv").symlink_to(ROOT / ".venv")
    scene = folder / "cases" / SCENE
    shutil.copytree(ROOT / "cases" / "single_finger" / "reference", scene / "reference")
    (scene / "scene.toml").write_text(SMALL, encoding="utf-8")
    return folder


def out_of(project: Path) -> Path:
    """Folder of the small scene's results."""
    return project / "cases" / SCENE / "out" / LEVEL


def files_of(out: Path, target: str) -> list[str]:
    """Names of the files of a target; the flow shows whether the case is right."""
    records = [read_record(out, stage) for stage in targets(target)]
    names = [name for record in records if record for name in record["outputs"]]
    return [name for name in names if name.split("/")[0] != "case"]


def command(target: str) -> list[str]:
    """The make of a target on one rank, without set-up."""
    make = shutil.which("make") or "make"
    options = ("--no-print-directory", f"LEVEL={LEVEL}", "NP=1", "QUIET=1")
    return [make, *options, target]


def start(project: Path, target: str, log: Path, **env: str) -> subprocess.Popen:
    """Start a make in a session of its own, its output added to `log`."""
    with log.open("a") as output:
        return subprocess.Popen(
            command(target), cwd=project, stdout=output, stderr=output, start_new_session=True,
            env=inner_environment(**env),
        )  # fmt: skip


def make(project: Path, target: str, **env: str) -> subprocess.CompletedProcess:
    """Run a make to its end."""
    environment = inner_environment(**env)
    return subprocess.run(
        command(target), cwd=project, capture_output=True, text=True, check=False, env=environment
    )


def kill(process: subprocess.Popen) -> None:
    """kill -9 of a make and its children; the solver, in its own session, must end by itself."""
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def solver_gone(project: Path, patience: float = 20.0) -> bool:
    """Whether no solver works in `project` after at most `patience` s."""
    deadline = time.monotonic() + patience
    while any(_works_in(path, project) for path in Path("/proc").glob("[0-9]*")):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.1)
    return True


def _works_in(process: Path, project: Path) -> bool:
    try:
        zombie = (process / "stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
        solver = (process / "comm").read_text().strip() == "pimpleFoam"
        folder = Path(os.readlink(process / "cwd"))
    except OSError:
        return False
    return solver and not zombie and folder.is_relative_to(project.resolve())


def complaints(text: str) -> list[str]:
    """Lines that a make has written of a failure, but for those of make itself."""
    own = re.compile(r"make\S*: \*\*\* .* Error [12]$")
    return [line for line in text.splitlines() if line.strip() and not own.match(line)]


def _difference(one: Path, other: Path) -> str | None:
    """The difference of two files of one name, besides time and number of attempts; None: equal."""
    if not (one.exists() and other.exists()):
        return f"{other.name} is missing" if one.exists() or other.exists() else None
    name = one.name
    if one.suffix == ".h5":
        return _difference_hdf5(one, other)
    if name in ("run.json", "history.csv"):
        a, b = (_columns(path) for path in (one, other))
        keys = sorted((a.keys() | b.keys()) - set(SPENT))
        differ = [key for key in keys if a.get(key) != b.get(key)]
        return f"{name}: {', '.join(differ)} differs" if differ else None
    if name in ("report.html", "comparison.json"):  # hold their date and the files' checksums
        return None if other.stat().st_size > 0.99 * one.stat().st_size else f"{name} is shorter"
    return None if one.read_bytes() == other.read_bytes() else f"{name} differs"


def _columns(path: Path) -> dict:
    """Values of a record, or bytes of each column of a table."""
    if path.suffix == ".json":
        return json.loads(path.read_text())
    table = np.genfromtxt(path, delimiter=",", names=True)
    return {name: table[name].tobytes() for name in table.dtype.names}


def _difference_hdf5(one: Path, other: Path) -> str | None:
    with h5py.File(one) as a, h5py.File(other) as b:
        names: list[list[str]] = [[], []]
        for file, members in zip((a, b), names, strict=True):
            file.visit(members.append)
        if changed := sorted(set(names[0]) ^ set(names[1])):
            return f"{one.name} holds other variables: {changed}"
        for name in (name for name in names[0] if isinstance(a[name], h5py.Dataset)):
            x, y = a[name][...], b[name][...]
            if x.shape != y.shape or x.dtype != y.dtype:
                return f"{one.name}: {name} has another shape"
            if x.tolist() != y.tolist() if x.dtype == object else x.tobytes() != y.tobytes():
                return f"{one.name}: {name} differs"
    return None


def compare_stages(stages: list[str], wanted: Path, folder: Path) -> str | None:
    """The first difference in the files of some stages; None where there is none."""
    names = [name for stage in stages for name in files_of(wanted, stage)]
    return next((d for name in names if (d := _difference(wanted / name, folder / name))), None)
