"""Where a scene's stage files are, and reading them with one-sentence errors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fileio import json_text
from fileio.atomic import write_text as write_text
from fileio.json_text import AGAIN
from fileio.provenance import read_settings
from fileio.toml_text import read_toml


@dataclass(frozen=True)
class StageFiles:
    """Paths of one scene at one level; `scene_folder` is cases/<scene>."""

    scene_folder: Path
    level: str

    @property
    def scene(self) -> str:
        return self.scene_folder.resolve().name

    @property
    def out(self) -> Path:
        return self.scene_folder / "out" / self.level

    @property
    def figures(self) -> Path:
        return self.out / "figures"

    @property
    def findings(self) -> Path:
        return self.scene_folder / "reference" / "findings.toml"

    def required(self, name: str, stage: str) -> Path:
        """Path of out/<level>/<name>; FileNotFoundError in one sentence that names the stage to run."""
        path = self.out / name
        if not path.exists():
            raise FileNotFoundError(
                f"{path} is missing; run the stage '{stage}' of {self.scene} at level {self.level} first"
            )
        return path

    def optional(self, name: str) -> Path | None:
        """Path of out/<level>/<name>, or None where the stage that makes it was not run."""
        path = self.out / name
        return path if path.exists() else None


def read_json(path: Path, kind: type = dict) -> Any:
    """What a stage's JSON file holds, of `kind`; ValueError in one sentence where it is damaged."""
    return json_text.read_json(path, AGAIN, kind)


def scene_numbers(files: StageFiles) -> dict[str, Any]:
    """The scene's sections (tank, finger, motion, model, fluid …) as the stages that used them recorded them."""
    numbers: dict[str, Any] = {}
    for name, stage in (
        ("kinematics.h5", "kinematics"),
        ("planform.h5", "mesh"),
        ("sweep.h5", "case"),
    ):
        numbers |= read_settings(files.required(name, stage))
    missing = [key for key in ("tank", "finger", "fluid", "model") if key not in numbers]
    if missing:
        raise ValueError(
            f"{files.out}: no stage recorded the scene's section {missing[0]!r}; run kinematics and mesh again"
        )
    return numbers


def scene_title(folder: Path) -> str:
    """`title` of scene.toml, or of the nearest scene that it extends; ValueError where there is none."""
    for path in extended_scenes(folder):
        table = read_toml(path / "scene.toml")
        if "title" in table:
            return str(table["title"])
    raise ValueError(f'{folder / "scene.toml"}: title is missing; add title = "…"')


def extended_scenes(folder: Path) -> list[Path]:
    """A scene's folder, and those of the scenes that it extends, nearest first."""
    table = read_toml(folder / "scene.toml")
    return [folder, *(extended_scenes(folder / table["extends"]) if "extends" in table else [])]
