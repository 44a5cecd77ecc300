"""Shared fixtures: small scenes made from the shipped ones."""

import atexit
import os
import shutil
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

import hypothesis
import pytest

from docs.evidence.small_scene import ROOT, TINY, meshes_of, write_scene
from pipeline.kinematics.finger import FingerMotion, finger_motion
from pipeline.runs.run import Run
from pipeline.scene.scene import Scene

__all__ = [
    "CASES", "CLOSING", "ROOT", "TINY", "meshes_of", "motion_of", "prepare", "run_stage",
    "write_scene",
]  # fmt: skip

# the shipped scenes without results: no test reads or changes those in the user's tree
CASES = Path(tempfile.mkdtemp(prefix="softfinger_cases_"))
shutil.copytree(ROOT / "cases", CASES, ignore=shutil.ignore_patterns("out"), dirs_exist_ok=True)
atexit.register(shutil.rmtree, CASES, ignore_errors=True)

# keys of a coupled pinch whose tips meet
CLOSING = """
[pinch]
half_distance = 0.034
[motion]
strokes = [{ pressure_kpa = 20.0, start = 0.002, duration = 0.15 }]
end_time = 0.2
source = "structure"
"""

os.environ.pop("TYPED", None)  # the values of the make that runs the tests are not theirs

# no test is timed: an example that takes a fifth of a second on a busy machine is no fault
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what needs OpenFOAM where it is missing; put long tests first in both halves.

    Two processes begin with a half each, and then take tests from the end of the other's half. So
    no module with a run that its tests share is divided, and the last tests are short ones.
    """
    if shutil.which("pimpleFoam") is None:
        missing = pytest.mark.skip(reason="OpenFOAM is not installed")
        for item in items:
            if item.get_closest_marker("openfoam"):
                item.add_marker(missing)
    modules = list(dict.fromkeys(item.path for item in items if item.path.parent.name == "cases"))
    one, other = ([i for i in items if i.path in modules[k::2]] for k in (0, 1))
    short = [item for item in items if item.path not in modules]
    rest = max(len(items) // 2 - len(one), 0)
    items[:] = [*one, *short[:rest], *other, *short[rest:]]


def motion_of(scene: Scene) -> FingerMotion:
    return finger_motion(scene.motion, scene.finger, scene.pinch, scene.folder)


@pytest.fixture
def tiny(tmp_path: Path) -> Scene:
    return write_scene(tmp_path / "tiny")


def run_stage(scene: Scene, stage: str, **options: Any) -> Any:
    """Call a stage's function, as the table of stages names it for this scene."""
    module = import_module(Run(scene).stage(stage).module)
    return module.run(scene, quiet=True, **options)


def prepare(scene: Scene) -> Scene:
    scene.out.mkdir(parents=True, exist_ok=True)
    for stage in ("kinematics", "mesh", "case"):
        run_stage(scene, stage)
    return scene
