"""Whether the bending states that a scene names are those of its own sections [actuator] and [fea]."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from fileio.errors import StageError
from fileio.formats.bending_states import read
from fileio.json_text import flat
from pipeline.fea.sections import sections
from pipeline.scene.read_toml import merge, read_layers
from pipeline.scene.scene import Scene

SAME_STATES = {
    "uncertainty",
    "partial",
    "under_load",
}  # of [fea]: what is said of the states, not the states


def check_states(scene: Scene) -> None:
    """StageError where states.h5 was analysed with other numbers than the scene has now, naming the first that differs.

    States that this project has not analysed (a CSV, a file without provenance), or that are not there, are left to the
    kinematics stage; so is a scene that has no actuator.
    """
    motion = scene.motion
    if not scene.actuator:
        return
    actuator, fea = sections(scene)  # are checked also where nothing is analysed
    if motion.source not in ("fea", "structure") or motion.states is None:
        return
    path = Path(os.path.normpath(scene.folder / motion.states))
    made = _provenance(path)
    if made is None:
        return
    now = _what_is_bent(actuator.model_dump(mode="json"), fea.model_dump(mode="json"))
    for key, was in _what_is_bent(*made).items():
        if key in now and now[key] != was:
            raise StageError(
                f"{scene.folder / 'scene.toml'}: {key} = {json.dumps(now[key])}, but {path} was analysed with"
                f" {json.dumps(was)}; {_remedy(scene, path)}, or take the change back"
            )


def _remedy(scene: Scene, path: Path) -> str:
    owner = path.parent.parent
    said: dict[str, Any] = {}
    for layer in read_layers(owner / "scene.toml") if (owner / "scene.toml").exists() else ():
        said = merge(said, layer.base)
    if owner == scene.folder or said.get("actuator") == scene.actuator:
        return f"analyse it anew with {_analysis_of(owner)}"
    return f"analyse this scene's own with {_analysis_of(scene.folder)}"


def _analysis_of(folder: Path) -> str:
    """The command that analyses the actuator of a scene; make knows those in cases/."""
    return (
        f"make fea SCENE={folder.name}"
        if folder.parent.name == "cases"
        else f"python -m pipeline fea {folder}"
    )


def _provenance(path: Path) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """Sections [actuator] and [fea] with which a file of states was analysed; None where it does not say."""
    try:
        about = read(path).about
        return about["geometry"] | {"materials": about["material"]}, about["settings"]
    except (StageError, KeyError, TypeError):
        return None


def _what_is_bent(actuator: dict[str, Any], fea: dict[str, Any]) -> dict[str, Any]:
    """By dotted key what the states follow from; imported ones from the results and the width alone."""
    fea = {key: value for key, value in fea.items() if key not in SAME_STATES}
    if fea.get("engine") == "import":
        actuator = {"width": actuator.get("width")}
        fea = {key: value for key, value in fea.items() if key in ("engine", "results")}
    else:
        fea.pop("solid_mesh" if fea.get("engine") == "unit_cell" else "mesh", None)
    return {
        key: value
        for key, value in flat({"actuator": actuator, "fea": fea}).items()
        if not key.endswith(".name")
    }
