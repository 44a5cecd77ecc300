"""A stage whose row does not name a key that its code reads would pass for fresh after a change."""

import typing
from collections import defaultdict
from typing import Any

import pytest
from pydantic import BaseModel

from docs.evidence.faults.project import small_run
from pipeline.runs.stages import STAGES, until
from pipeline.scene.scene import Scene
from softfinger.make import Machine, make_stage

pytestmark = [pytest.mark.openfoam, pytest.mark.slow]


def models() -> dict[type[BaseModel], str]:
    """The model of each section of a scene, and the section's name."""
    found = {}
    for section, field in Scene.model_fields.items():
        for kind in (field.annotation, *typing.get_args(field.annotation)):
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                found[kind] = section
    return found


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> set[tuple[str, str]]:
    """Section and name of each key that any code reads from now on."""
    seen: set[tuple[str, str]] = set()

    def watch(model: type[BaseModel], section: str) -> None:
        plain, keys = model.__getattribute__, frozenset(model.model_fields)

        def get(self: BaseModel, name: str) -> Any:
            if name in keys:
                seen.add((section, name))
            return plain(self, name)

        monkeypatch.setattr(model, "__getattribute__", get)

    for model, section in models().items():
        watch(model, section)
    return seen


def named(stage: str) -> dict[str, set[str]]:
    """Keys by section that a stage and those before it name; "*" for a whole section."""
    keys: dict[str, set[str]] = defaultdict(set)
    for step in until(stage):
        for section, some in step.sections.items():
            keys[section] |= {"*"} if some is True else some
    return keys


def test_each_stage_names_the_keys_of_the_scene_that_it_reads(tmp_path, read) -> None:
    run = small_run(tmp_path / "small")
    unnamed, seen = {}, set()
    for stage in STAGES:
        read.clear()
        make_stage(run, stage.name, Machine(), quiet=True)
        keys, seen = named(stage.name), seen | read
        unnamed[stage.name] = {
            f"{section}.{key}" for section, key in read if not keys[section] & {"*", key}
        }
    forgotten = {stage: keys for stage, keys in unnamed.items() if keys}
    assert not forgotten, f"add to sections of these rows in pipeline/runs/stages.py: {forgotten}"
    assert {"mesh", "fluid", "sheet", "camera", "structure"} <= {section for section, _ in seen}
