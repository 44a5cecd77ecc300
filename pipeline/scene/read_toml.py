"""Reading scene.toml: its tables, merged with those of the scenes that it extends."""

import os
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import Any

from pipeline.scene.toml_text import read_toml
from piv.files.errors import StageError, suggestion
from piv.files.json_text import flat

# of [motion]: files, relative to the scene that names them
FILE_KEYS = {"states", "pressure_csv", "recording", "path_csv"}
_REPLACED = {"parameters"}  # of a material's law: those of another law would be left over
# of [motion]: a key that is not empty replaces the others
_HISTORIES = {"pressure_csv": {"strokes", "start_pressure_kpa"}, "strokes": {"pressure_csv"}}
# of a parent's finger and motion: they follow from those of a child that has others
_FOLLOWING = (
    ("camera", "centre"),
    ("camera", "scale_mm_per_px"),
    ("camera", "columns"),
    ("camera", "rows"),
    ("sheet", "spacing"),
    ("vortices", "min_circulation"),
)
_MOVING = {"tank", "finger", "motion", "actuator", "pinch"}
OWN_STATES = "kinematics/states.h5"  # of make fea: in a scene's folder they replace a parent's


def command(name: str, folder: Path, level: str = "") -> str:
    """A command on a scene: make's where the folder lies in cases/, else the program's."""
    scene = folder.resolve()
    if scene.parent == Path("cases").resolve():
        place = quote(scene.name)
        words = f"make {place}" if name == "run" else f"make {name} SCENE={place}"
        return f"{words} LEVEL={level}" if level else words
    return f"softfinger {name} {quote(str(folder))}" + (f" --level {level}" if level else "")


def merge(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """`base` with the entries of `over`, table by table."""
    merged = dict(base)
    for key in _HISTORIES.keys() & over.keys():
        for other in _HISTORIES[key] if over[key] else ():
            merged.pop(other, None)
    for key, value in over.items():
        both = (
            isinstance(value, dict) and isinstance(merged.get(key), dict) and key not in _REPLACED
        )
        merged[key] = merge(merged[key], value) if both else value
    return merged


@dataclass(frozen=True)
class Layer:
    """One scene.toml of a chain of `extends`: its tables for all levels, and those of each."""

    path: Path
    base: dict[str, Any]
    levels: dict[str, Any]


def read_layers(path: Path, children: tuple[Path, ...] = ()) -> list[Layer]:
    """A scene.toml after all that it extends; file names are relative to its folder. StageError."""
    try:
        table = read_toml(path)
    except FileNotFoundError:
        raise StageError(
            f"{path}: no such scene; give the folder of a scene.toml, as cases/single_finger"
        ) from None
    parent = table.pop("extends", None)
    levels = table.pop("levels", {})
    if not (isinstance(levels, dict) and all(isinstance(v, dict) for v in levels.values())):
        raise StageError(f"{path}: levels: give tables, as [levels.coarse]")
    layers = [Layer(path, table, levels)]
    if parent is None:
        return layers
    if not isinstance(parent, str):
        raise StageError(
            f"{path}: extends: give the folder of another scene as text (got {parent!r})"
        )
    chain = (*children, path.resolve())
    base = path.parent / parent / "scene.toml"
    if base.resolve() in chain:
        raise StageError(f"{path}: extends: {parent} extends this scene in turn; break the circle")
    if not base.is_file():
        near = (found.parent.name for found in base.parent.parent.glob("*/scene.toml"))
        raise StageError(
            f"{path}: extends = {parent!r}: no scene is there{suggestion(base.parent.name, near)};"
            " give its folder"
        )
    inherited = read_layers(base, chain)
    for layer in inherited:
        for part in (layer.base, *layer.levels.values()):
            _move_files(part.get("motion"), parent, (path.parent / OWN_STATES).exists())
            if isinstance(current := part.get("current"), dict) and "table" in current:
                current["table"] = os.path.join(parent, str(current["table"]))
    return [*inherited, *layers]


def resolve(layers: list[Layer], level: str) -> tuple[dict[str, Any], dict[str, Path]]:
    """The tables of a scene at a level, and values of a parent's level that a child replaced.

    Later ones win: the parent's tables, those of its level, the child's, those of its level. The
    second result: the file that replaced a level's value for all levels, by dotted key. StageError.
    """
    names = _level_chain(layers, level)
    table: dict[str, Any] = {}
    of_levels: dict[str, Any] = {}
    replaced: dict[str, Path] = {}
    for layer in layers:
        stated = "centre" in layer.base.get("camera", {}) or "body" in table
        if _MOVING & layer.base.keys() and not stated:
            table = _without_view(table)
        for key, value in flat(layer.base).items():
            # a child of another motion has a view of its own at all levels
            own = _MOVING & layer.base.keys() and tuple(key.split(".")) in _FOLLOWING
            if of_levels.get(key, value) != value and not own:
                replaced[key] = layer.path
        table = merge(table, layer.base)
        for name in names:
            added = layer.levels.get(name, {})
            table = merge(table, added)
            of_levels |= flat(added)
            replaced = {key: by for key, by in replaced.items() if key not in flat(added)}
    table.pop("extends", None)
    return table, replaced


def _without_view(table: dict[str, Any]) -> dict[str, Any]:
    """The tables without the keys of the measurement that follow from the motion."""
    return {
        name: {key: v for key, v in part.items() if (name, key) not in _FOLLOWING}
        if isinstance(part, dict)
        else part
        for name, part in table.items()
    }


def _level_chain(layers: list[Layer], level: str) -> list[str]:
    """`level` after the levels that it extends in turn."""
    path = layers[-1].path
    levels: dict[str, Any] = {}
    for layer in layers:
        levels = merge(levels, layer.levels)
    if level not in levels:
        known = ", ".join(sorted(levels)) or "missing"
        raise StageError(
            f"{path}: no level {level!r}{suggestion(level, levels)}; the levels are {known}"
        )
    names = [level]
    while (parent := levels[names[0]].get("extends")) is not None:
        where = f"{path}: levels.{names[0]}.extends"
        if parent in names:
            raise StageError(f"{where}: {parent} extends this level in turn; break the circle")
        if not isinstance(parent, str) or parent not in levels:
            raise StageError(f"{where}: give another level of this scene (got {parent!r})")
        names.insert(0, parent)
    return names


def _move_files(motion: Any, folder: str, own_states: bool) -> None:
    """Make file names in the parent's `folder` relative to the scene that extends it.

    With `own_states`, the scene's own bending states replace the parent's.
    """
    for key in FILE_KEYS & motion.keys() if isinstance(motion, dict) else ():
        if isinstance(motion[key], str):
            motion[key] = os.path.join(folder, motion[key])
    if own_states and isinstance(motion, dict) and "states" in motion:
        motion["states"] = OWN_STATES
