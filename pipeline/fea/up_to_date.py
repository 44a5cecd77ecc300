"""Staleness of a scene's bending states against its sections [actuator] and [fea]."""

import json
import os
from pathlib import Path
from typing import Any

from pipeline.fea.sections import check_length, sections
from pipeline.formats.bending_states import read
from pipeline.scene.read_toml import command, merge, read_layers
from pipeline.scene.scene import Scene
from piv.files.errors import StageError
from piv.files.json_text import flat

_NOT_OF_THE_STATES = {"uncertainty", "partial", "under_load"}  # keys of [fea] on their accuracy


def check_states(scene: Scene) -> None:
    """StageError with the first key of the scene that differs from that of its states.h5.

    Missing states, states without provenance (as in a CSV) and scenes without an actuator pass:
    the kinematics stage checks them.
    """
    motion = scene.motion
    if not scene.actuator:
        return
    actuator, fea = sections(scene)  # checks them also where no states are used
    if motion.source not in ("fea", "structure") or motion.states is None:
        return
    path = Path(os.path.normpath(scene.folder / motion.states))
    made = _provenance(path)
    if made is None:
        return
    if fea.engine == "unit_cell":
        check_length(scene, actuator)
    now = _inputs(actuator.model_dump(mode="json"), fea.model_dump(mode="json"))
    for key, was in _inputs(*made).items():
        if key in now and now[key] != was:
            raise StageError(
                f"{scene.folder / 'scene.toml'}: {key} = {json.dumps(now[key])}, but {path} was"
                f" analysed with {json.dumps(was)}; {_remedy(scene, path)}, or take the change back"
            )


def _remedy(scene: Scene, path: Path) -> str:
    owner = path.parent.parent
    table: dict[str, Any] = {}
    for layer in read_layers(owner / "scene.toml") if (owner / "scene.toml").exists() else ():
        table = merge(table, layer.base)
    equal = all(table.get(key, {}) == getattr(scene, key) for key in ("actuator", "fea"))
    same = owner == scene.folder or equal
    folder = owner if same else scene.folder
    own = "it anew" if same else "this scene's own"
    return f"analyse {own} with {command('fea', folder)}"


def _provenance(path: Path) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """Sections [actuator] and [fea] that a file of states records; None without provenance."""
    try:
        about = read(path).about
        return about["geometry"] | {"materials": about["material"]}, about["settings"]
    except (StageError, KeyError, TypeError):
        return None


def _inputs(actuator: dict[str, Any], fea: dict[str, Any]) -> dict[str, Any]:
    """Keys that the states depend on; imported states depend on results and width alone."""
    fea = {key: value for key, value in fea.items() if key not in _NOT_OF_THE_STATES}
    if fea.get("engine") == "import":
        actuator = {"width": actuator.get("width")}
        fea = {key: value for key, value in fea.items() if key in ("engine", "results")}
    return {
        key: value
        for key, value in flat({"actuator": actuator, "fea": fea}).items()
        if not key.endswith(".name")
    }
