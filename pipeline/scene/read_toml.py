"""Reading scene.toml: tables, and what they inherit from the scene that they extend."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import Any

from fileio.errors import StageError

FILE_KEYS = {
    "states",
    "pressure_csv",
    "recording",
}  # of [motion]: paths relative to the scene that gives them
REPLACED = {"parameters"}  # of a material's law: those of another law would be left over


def merge(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """`base` with the entries of `over`, table by table."""
    merged = dict(base)
    for key, value in over.items():
        both = isinstance(value, dict) and isinstance(merged.get(key), dict) and key not in REPLACED
        merged[key] = merge(merged[key], value) if both else value
    return merged


def read_tables(path: Path, children: tuple[Path, ...] = ()) -> dict[str, Any]:
    """The tables of a scene.toml, on top of those of the scene that it extends. Raises StageError."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise StageError(
            f"{path}: no such scene; give the folder of a scene.toml, as cases/single_finger"
        ) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise StageError(f"{path}: not valid TOML: {error}") from None
    parent = table.pop("extends", None)
    if parent is None:
        return table
    if not isinstance(parent, str):
        raise StageError(f"{path}: extends: give the folder of another scene as text (got {parent!r})")
    chain = (*children, path.resolve())
    base = path.parent / parent / "scene.toml"
    if base.resolve() in chain:
        raise StageError(f"{path}: extends: {parent} extends this scene in turn; break the circle")
    return merge(_moved(read_tables(base, chain), parent), table)


def scene_files(path: Path) -> list[Path]:
    """A scene.toml that was read before, and those that it extends, in turn."""
    parent = tomllib.loads(path.read_text(encoding="utf-8")).get("extends")
    return [path] if parent is None else [path, *scene_files(path.parent / parent / "scene.toml")]


def level_tables(levels: Any, level: str, path: Path, children: tuple[str, ...] = ()) -> dict[str, Any]:
    """What `[levels.<level>]` says, on top of the level of the same scene that it extends, if any. Raises StageError."""
    if not isinstance(levels, dict) or not isinstance(levels.get(level, {}), dict):
        raise StageError(f"{path}: levels: give tables, as [levels.coarse]")
    if level not in levels:
        raise StageError(
            f"{path}: no level {level!r}; the levels are {', '.join(sorted(levels)) or 'missing'}"
        )
    table = dict(levels[level])
    parent = table.pop("extends", None)
    if parent is None:
        return table
    chain = (*children, level)
    if parent in chain:
        raise StageError(
            f"{path}: levels.{level}.extends: {parent} extends this level in turn; break the circle"
        )
    if not isinstance(parent, str) or parent not in levels:
        raise StageError(f"{path}: levels.{level}.extends: give another level of this scene (got {parent!r})")
    return merge(level_tables(levels, parent, path, chain), table)


def _moved(table: dict[str, Any], folder: str) -> dict[str, Any]:
    """A parent's table whose file names, given relative to its own `folder`, hold for the scene that extends it."""
    motions = [t.get("motion") for t in (table, *_tables(table.get("levels")))]
    for motion in _tables(dict(enumerate(motions))):
        for key in FILE_KEYS & motion.keys():
            if isinstance(motion[key], str):
                motion[key] = os.path.join(folder, motion[key])
    return table


def _tables(value: Any) -> list[dict[str, Any]]:
    return [t for t in value.values() if isinstance(t, dict)] if isinstance(value, dict) else []
