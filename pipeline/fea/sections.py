"""The sections [actuator] and [fea] of a scene, checked."""

from __future__ import annotations

from pydantic import ValidationError

from fileio.errors import StageError
from pipeline.fea.settings import Actuator, Fea
from pipeline.scene.scene import Scene
from pipeline.scene.section import validation_sentence


def sections(scene: Scene) -> tuple[Actuator, Fea]:
    """The actuator and its analysis; StageError naming all keys that are wrong."""
    name = "actuator"
    try:
        actuator = Actuator(**scene.actuator)
        name = "fea"
        return actuator, Fea(**scene.fea)
    except ValidationError as error:
        sentence = validation_sentence(error, Fea if name == "fea" else Actuator, name)
        raise StageError(f"{scene.folder / 'scene.toml'}: {sentence}") from None
