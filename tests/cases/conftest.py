"""A copy of the project in which scenes are made, and readers of runs."""

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from pipeline.scene.scene import Scene, load_scene
from pipeline.solve import guards
from piv.files.errors import StageError
from tests.conftest import ROOT, run_stage
from tests.inner_make import inner_environment


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    folder = tmp_path_factory.mktemp("project")
    for name in ("Makefile", "requirements.lock", "pyproject.toml"):
        shutil.copy2(ROOT / name, folder / name)
    for name in ("cases", "pipeline", "piv", "postprocess", "softfinger"):  # with numba's cache
        ignored = shutil.ignore_patterns("out", ".snakemake")
        shutil.copytree(ROOT / name, folder / name, ignore=ignored)
    (folder / ".venv").symlink_to(ROOT / ".venv")
    return folder


def make(project: Path, *arguments: str) -> subprocess.CompletedProcess:
    options = ("--no-print-directory", "LEVEL=smoke")
    command, environment = ["make", *options, *arguments], inner_environment()
    return subprocess.run(
        command, cwd=project, capture_output=True, text=True, check=False, env=environment
    )


def solving(scene: Scene) -> list[str]:
    """The command of a process that runs the solver of a prepared scene, and no other stage."""
    code = "import sys; from tests.conftest import run_stage; from pipeline.scene.scene import *"
    code += "; run_stage(load_scene(sys.argv[1], 'tiny'), 'solve')"
    return [sys.executable, "-c", code, str(scene.folder)]


@contextmanager
def killed_after(scene: Scene, files: str, count: int = 1) -> Iterator[None]:
    """Run the solver until so many `files` (a pattern of the case) are there, then kill it, -9."""
    process = subprocess.Popen(solving(scene), cwd=ROOT)
    deadline = time.monotonic() + 600
    try:
        while len([*scene.out.glob(f"case/{files}")]) < count and time.monotonic() < deadline:
            assert process.poll() is None, "the run ended before it could be killed"
            time.sleep(0.005)
        yield
    finally:
        process.kill()
        process.wait()
    time.sleep(0.5)  # the solver, which may wait for its next step, must notice
    assert not (scene.out / "run" / "run.json").exists()


def copy_of(scene: Scene, folder: Path) -> Scene:
    shutil.copytree(scene.folder, folder, symlinks=True)
    return load_scene(folder, scene.level)


def table(scene: Scene, name: str = "forces") -> np.ndarray:
    return np.loadtxt(scene.out / "run" / f"{name}.csv", delimiter=",", skiprows=1)


def record(scene: Scene) -> dict:
    return json.loads((scene.out / "run" / "run.json").read_text())


def force_difference(scene: Scene, other: Scene) -> float:
    """Largest difference of the forces in the plane, over the largest force."""
    one, two = table(scene), table(other)
    assert one[:, 0] == pytest.approx(two[:, 0])
    return np.abs(one[:, 1:3] - two[:, 1:3]).max() / np.abs(one[:, 1:3]).max()


@pytest.fixture(scope="module")
def solved(prepared, tmp_path_factory):
    """The module's prepared scene, solved without a stop on one rank."""
    scene = copy_of(prepared, tmp_path_factory.mktemp("solved") / "scene")
    run_stage(scene, "solve")
    return scene


@pytest.fixture
def stop_at(monkeypatch):
    """A function that runs a scene until a guard stops it at a time (s)."""

    def stop(scene: Scene, at: float, **options) -> None:
        class Stop(guards.Guard):
            def verdict(self, line):
                return super().verdict(line) or ("test" if self.time >= at else None)

        with monkeypatch.context() as patch:
            patch.setattr(guards, "Guard", Stop)
            with pytest.raises(StageError, match="by a guard: test"):
                run_stage(scene, "solve", **options)
        # the files are kept, and nothing says that the run is whole
        assert any(log.stat().st_size for log in scene.out.glob("case/*/log.pimpleFoam"))
        assert not (scene.out / "run" / "run.json").exists()

    return stop
