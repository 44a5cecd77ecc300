"""Shared fixtures: small scenes made from the shipped ones."""

import os
import shutil
from importlib import import_module
from pathlib import Path
from typing import Any

import hypothesis
import pytest

from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.mesh_intervals import IntervalMesh, read_meshes
from pipeline.kinematics.finger import FingerMotion, finger_motion
from pipeline.runs.run import Run
from pipeline.scene.scene import Scene, load_scene

ROOT = Path(__file__).resolve().parent.parent

os.environ.pop("TYPED", None)  # the values of the make that runs the tests are not theirs

# no test is timed: an example that takes a fifth of a second on a busy machine is no fault
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")

TINY = """
extends = "{parent}"
{more}
[levels.tiny]
model = {{ kind = "{kind}" }}
mesh = {{ wall_cell = 3.5e-3, wall_first_layer = 1.2e-3, wall_layers = 2, \
tip_cell = 2.2e-3, near_cell = 5e-3, near_distance = 0.01, far_cell = 0.05, \
edge_layer = 14e-3, sheet_layer = 8e-3, layer_growth = 5 }}
numerics = {{ time_step = 1e-3, write_interval = 0.01{numerics} }}
"""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests that need OpenFOAM are skipped where it is not installed."""
    if shutil.which("pimpleFoam") is None:
        missing = pytest.mark.skip(reason="OpenFOAM is not installed")
        for item in items:
            if item.get_closest_marker("openfoam"):
                item.add_marker(missing)


def write_scene(
    folder: Path,
    kind: str = "2d",
    more: str = "",
    numerics: str = "",
    parent: str = "single_finger",
) -> Scene:
    """A scene of a few hundred cells in `folder` that differs from a shipped one only as said."""
    folder.mkdir(parents=True, exist_ok=True)
    text = TINY.format(parent=ROOT / "cases" / parent, kind=kind, more=more, numerics=numerics)
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    states = ROOT / "cases" / "single_finger" / "kinematics"
    (folder / "kinematics").symlink_to(states) if not (folder / "kinematics").exists() else None
    return load_scene(folder, "tiny")


def motion_of(scene: Scene) -> FingerMotion:
    return finger_motion(scene.motion, scene.finger, scene.pinch, scene.folder)


def meshes_of(scene: Scene) -> list[IntervalMesh]:
    return read_meshes(scene.out, read_kinematics(scene.out / "kinematics.h5").law)


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
