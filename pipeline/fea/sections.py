"""The sections [actuator] and [fea] of a scene, checked."""

from __future__ import annotations

from pydantic import ValidationError

from fileio.errors import StageError
from pipeline.fea.settings import Actuator, Fea
from pipeline.scene.scene import Scene
from pipeline.scene.section import validation_sentence


def sections(scene: Scene) -> tuple[Actuator, Fea]:
    """What a scene says of its actuator and its analysis; StageError naming all keys that are wrong."""
    section = "actuator"
    try:
        actuator = Actuator(**scene.actuator)
        section = "fea"
        return actuator, Fea(**scene.fea)
    except ValidationError as error:
        raise StageError(
            f"{scene.folder / 'scene.toml'}: {validation_sentence(error, Fea if section == 'fea' else Actuator, section)}"
        ) from None
