"""A small copy of the project to be broken: one scene of a few hundred cells, from kinematics to the report."""

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

from fileio.stages import BY_NAME, STAGES
from tests.inner_make import inner_environment

ROOT = Path(__file__).resolve().parents[3]
PARTS = (
    "Makefile",
    "requirements.lock",
    "pyproject.toml",
    "cases",
    "fileio",
    "pipeline",
    "piv",
    "postprocess",
)
SCENE, LEVEL = "small", "tiny"

SMALL = """# A stroke of 60 ms in 2-D on a coarse mesh: every stage takes seconds.
extends = "../single_finger"
title = "Small"
[motion]
strokes = [{ pressure_kpa = 12.0, start = 0.002, duration = 0.05 }]
end_time = 0.06
[levels.tiny]
model = { kind = "2d" }
mesh = { wall_cell = 3.5e-3, wall_first_layer = 1.2e-3, wall_layers = 2, tip_cell = 2.2e-3, near_cell = 5e-3, near_distance = 0.01, far_cell = 0.05 }
numerics = { time_step = 1e-3, write_interval = 0.01, non_orthogonal_correctors = 0 }
sheet = { spacing = 2e-3 }
camera = { columns = 320, rows = 256, centre = [0.01, 0.185] }
piv = { every = 2, preset = "fast" }
"""

# What each target leaves for the next, in the order of the chain; a case is compared by what is solved on it.
PRODUCTS: dict[str, tuple[str, ...]] = {}
for _stage in STAGES:
    PRODUCTS[_stage.target] = (
        *PRODUCTS.get(_stage.target, ()),
        *(f for f in _stage.outputs if f != "case"),
    )
SPENT = (
    "wall_time",
    "resumed",
)  # what a resumed run does not repeat; all other numbers are the same to the last bit


def copy_project(folder: Path) -> Path:
    """The project without results in `folder`, with this environment linked in and the small scene added.

    What numba has compiled comes along.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for part in PARTS:
        source = ROOT / part
        if source.is_dir():
            shutil.copytree(
                source, folder / part, ignore=shutil.ignore_patterns("out", ".snakemake")
            )
        else:
            shutil.copy2(source, folder / part)
    (folder / ".venv").symlink_to(ROOT / ".venv")
    (folder / "cases" / SCENE).mkdir()
    (folder / "cases" / SCENE / "scene.toml").write_text(SMALL, encoding="utf-8")
    reference = ROOT / "cases" / "single_finger" / "reference"
    shutil.copytree(reference, folder / "cases" / SCENE / "reference")
    return folder


def out_of(project: Path) -> Path:
    """Where the small scene's results are."""
    return project / "cases" / SCENE / "out" / LEVEL


def command(target: str, level: str = LEVEL, ranks: int = 1) -> list[str]:
    """The make that a user would type, told that the set-up is there."""
    return [
        shutil.which("make") or "make",
        "--no-print-directory",
        f"LEVEL={level}",
        f"NP={ranks}",
        "QUIET=1",
        "READY=Makefile",
        target,
    ]


def start(project: Path, target: str, log: Path, **env: str) -> subprocess.Popen:
    """A make of `target` in a session of its own, its output added to `log`."""
    with log.open("a") as output:
        return subprocess.Popen(
            command(target),
            cwd=project,
            stdout=output,
            stderr=output,
            start_new_session=True,
            env=inner_environment(**env),
        )


def make(project: Path, target: str, **env: str) -> subprocess.CompletedProcess:
    """A make of `target` to its end."""
    return subprocess.run(
        command(target),
        cwd=project,
        capture_output=True,
        text=True,
        check=False,
        env=inner_environment(**env),
    )


def kill(process: subprocess.Popen) -> None:
    """kill -9 of a make and of all that it has started; the solver, in its own session, must notice by itself."""
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def solver_gone(project: Path, patience: float = 20.0) -> bool:
    """Whether no solver is left that works in `project`, after `patience` s at the most."""
    deadline = time.monotonic() + patience
    while time.monotonic() < deadline:
        if not any(
            _works_in(pid, project) for pid in Path("/proc").iterdir() if pid.name.isdigit()
        ):
            return True
        time.sleep(0.1)
    return False


def _works_in(process: Path, project: Path) -> bool:
    try:
        if (process / "stat").read_text().rsplit(")", 1)[1].split()[0] == "Z":
            return False
        name = (process / "comm").read_text().strip()
        return name == "pimpleFoam" and Path(os.readlink(process / "cwd")).is_relative_to(
            project.resolve()
        )
    except OSError:
        return False


def complaints(text: str) -> list[str]:
    """Lines of a make's output that a stage has written: `<stage>: sentence`; make's own and progress left out."""
    stages = "|".join(["settings", "piv \\w+", *BY_NAME])
    made = r"Makefile:\d+: \*\*\* .*  Stop\.$"  # make itself refuses
    return [line for line in text.splitlines() if re.match(rf"({stages}): |{made}", line)]


def difference(one: Path, other: Path) -> str | None:
    """In what two files of the same name differ, beyond when and how often they were made; None where in nothing."""
    if not (one.exists() and other.exists()):
        return f"{other.name} is missing" if one.exists() or other.exists() else None
    if one.suffix == ".h5":
        return _difference_hdf5(one, other)
    if one.name == "run.json":
        return _difference_json(one, other)
    if one.name == "history.csv":
        return _difference_history(one, other)
    if one.name in (
        "report.html",
        "comparison.json",
    ):  # say when they were made, and of which files
        return (
            None if other.stat().st_size > 0.99 * one.stat().st_size else f"{one.name} is shorter"
        )
    return None if one.read_bytes() == other.read_bytes() else f"{one.name} differs"


def _difference_hdf5(one: Path, other: Path) -> str | None:
    with h5py.File(one) as a, h5py.File(other) as b:
        names: list[list[str]] = [[], []]
        for file, members in zip((a, b), names, strict=True):
            file.visit(members.append)
        if sorted(names[0]) != sorted(names[1]):
            return f"{one.name} holds other variables: {sorted(set(names[0]) ^ set(names[1]))}"
        for name in (name for name in names[0] if isinstance(a[name], h5py.Dataset)):
            x, y = a[name][...], b[name][...]
            if x.shape != y.shape or x.dtype != y.dtype:
                return f"{one.name}: {name} has another shape"
            texts = x.dtype == object
            if x.tolist() != y.tolist() if texts else x.tobytes() != y.tobytes():
                return f"{one.name}: {name} differs"
    return None


def _difference_json(one: Path, other: Path) -> str | None:
    a, b = (json.loads(p.read_text()) for p in (one, other))
    differ = [
        key for key in sorted(a.keys() | b.keys()) if key not in SPENT and a.get(key) != b.get(key)
    ]
    return f"{one.name}: {', '.join(differ)} differs" if differ else None


def _difference_history(one: Path, other: Path) -> str | None:
    a, b = (np.genfromtxt(p, delimiter=",", names=True) for p in (one, other))
    differ = [
        name
        for name in a.dtype.names
        if name not in SPENT and a[name].tobytes() != b[name].tobytes()
    ]
    return f"{one.name}: {', '.join(differ)} differs" if differ else None


def compare_stage(stage: str, wanted: Path, folder: Path) -> str | None:
    """The first difference in what a stage has made; None where there is none."""
    return next(
        (d for name in PRODUCTS[stage] if (d := difference(wanted / name, folder / name))), None
    )
