"""The keys of scene.toml and a template, from the models of a scene."""

from pipeline.fea.settings import Actuator, Fea
from pipeline.scene.key_reference import MISSING, Key, keys_of, template
from pipeline.scene.scene import Scene

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


def scene_template() -> str:
    """A scene.toml to start from: required keys are open, others are comments with defaults."""
    return template(keys())
