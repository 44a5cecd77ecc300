"""The table of the keys of scene.toml and a template, from the models of a scene."""

from __future__ import annotations

from pathlib import Path

from fileio.atomic import write_text
from fileio.json_text import flat
from fileio.key_reference import MISSING, Key, csv_text, keys_of, template
from pipeline.fea.settings import Actuator, Fea
from pipeline.scene.read_toml import read_layers
from pipeline.scene.scene import Scene

PAGE = Path("docs/reference/scene_keys.csv")
_OWN = [
    Key("title", "text", "", MISSING, "Of the scene, for people"),
    Key("extends", "text", "", "", "Folder of another scene; this one holds only the differences"),
    Key("levels", "table", "", MISSING, "Differences of each level, as [levels.coarse.mesh]"),
]


def keys() -> list[Key]:
    """All keys of a scene."""
    made = frozenset(
        {"name", "title", "level", "folder", "parents", "out", "notes", "actuator", "fea"}
    )
    all_keys = [
        *_OWN,
        *keys_of(Scene, without=made),
        *keys_of(Actuator, "actuator.", optional=True),
    ]
    all_keys += keys_of(Fea, "fea.", optional=True)
    # keys of one table are adjacent, at the place of its first key
    tables = [key.name.rpartition(".")[0] for key in all_keys]
    return sorted(all_keys, key=lambda key: tables.index(key.name.rpartition(".")[0]))


def reference() -> str:
    """The table; its last column names the levels of single_finger that set another value."""
    levels: dict[str, str] = {}
    for layer in read_layers(Path("cases/single_finger/scene.toml")):
        for level, table in layer.levels.items():
            for name in flat(table):
                levels[name] = ", ".join(filter(None, (levels.get(name), level)))
    return csv_text(keys(), levels)


def write_reference() -> None:
    """Write docs/reference/scene_keys.csv."""
    write_text(PAGE, reference())


def scene_template() -> str:
    """A scene.toml to start from: required keys are open, others are comments with defaults."""
    return template(keys())
