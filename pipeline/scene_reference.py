"""The reference of scene.toml, docs/scene_reference.md, and a scene to start from, from the models of its sections."""

from __future__ import annotations

from pathlib import Path

from fileio.atomic import write_text
from fileio.json_text import flat
from fileio.key_reference import MISSING, Key, keys_of, markdown, template
from pipeline.fea.settings import Actuator, Fea
from pipeline.scene.read_toml import read_layers
from pipeline.scene.scene import Scene

SHIPPED = Path("cases/single_finger")
PAGE = Path("docs/scene_reference.md")
HEAD = """# Every key of scene.toml

Written by `softfinger reference` from the models that check a scene; a test keeps them equal. SI, but for keys whose name says otherwise.
A list of tables has its keys under `[name[]]`. *levels*: those of `cases/single_finger` that say otherwise. A file to start from:
`softfinger new --template`. What a level or a child scene says wins as [formats](formats.md) has it.
"""
OWN = [
    Key("title", "text", "", MISSING, "Of the scene, for people"),
    Key(
        "extends",
        "text",
        "",
        "",
        "Folder of another scene, of which this one says only what differs",
    ),
    Key(
        "levels",
        "table",
        "",
        MISSING,
        "Tables of what differs at each level, as [levels.coarse.mesh]",
    ),
]


def keys() -> list[Key]:
    """All keys of a scene."""
    made = frozenset(
        {"name", "title", "level", "folder", "parents", "out", "notes", "actuator", "fea"}
    )
    all_keys = [*OWN, *keys_of(Scene, without=made), *keys_of(Actuator, "actuator.", optional=True)]
    all_keys += keys_of(Fea, "fea.", optional=True)
    tables = [
        key.name.rpartition(".")[0] for key in all_keys
    ]  # those of one table stand together, where its first does
    return sorted(all_keys, key=lambda key: tables.index(key.name.rpartition(".")[0]))


def reference() -> str:
    """The page."""
    levels: dict[str, str] = {}
    for layer in read_layers(SHIPPED / "scene.toml"):
        for level, table in layer.levels.items():
            for name in flat(table):
                levels[name] = ", ".join(filter(None, (levels.get(name), level)))
    return HEAD + markdown(keys(), levels)


def write_reference() -> None:
    """Write docs/scene_reference.md."""
    write_text(PAGE, reference())


def scene_template() -> str:
    """A scene.toml to start from: required keys are open, others are comments with defaults."""
    return template(keys())
