"""A small scene made from a shipped one, and public data, for tests and campaigns."""

import os
from pathlib import Path

from pipeline.formats.kinematics import read_kinematics
from pipeline.formats.mesh_intervals import IntervalMesh, read_meshes
from pipeline.scene.scene import Scene, load_scene

ROOT = Path(__file__).resolve().parents[2]
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


def write_scene(
    folder: Path,
    kind: str = "2d",
    more: str = "",
    numerics: str = "",
    parent: str = "single_finger",
) -> Scene:
    """Write a scene into `folder` and load it: the shipped `parent` with `more` TOML text."""
    folder.mkdir(parents=True, exist_ok=True)
    text = TINY.format(parent=ROOT / "cases" / parent, kind=kind, more=more, numerics=numerics)
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    states = ROOT / "cases" / "single_finger" / "kinematics"
    (folder / "kinematics").symlink_to(states) if not (folder / "kinematics").exists() else None
    return load_scene(folder, "tiny")


def meshes_of(scene: Scene) -> list[IntervalMesh]:
    """Read the mesh and its motion of every interval of a scene's run."""
    return read_meshes(scene.out, read_kinematics(scene.out / "kinematics.h5").law)


def shared_data() -> Path | None:
    """Public recordings and fields of others: beside the repository, or as SHARED_DATA says."""
    if "SHARED_DATA" in os.environ:
        return Path(os.environ["SHARED_DATA"])
    for parent in Path(__file__).resolve().parents:
        if (parent / "shared" / "data").is_dir():
            return parent / "shared" / "data"
    return None
