"""The sections [actuator] and [fea] of a scene, checked."""

from __future__ import annotations

from pydantic import ValidationError

from pipeline.errors import StageError
from pipeline.fea.settings import Actuator, Fea
from pipeline.scene import Scene


def sections(scene: Scene) -> tuple[Actuator, Fea]:
    """What a scene says of its actuator and its analysis; StageError naming the first key that is wrong."""
    try:
        return Actuator(**scene.actuator), Fea(**scene.fea)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"])) or "[actuator] or [fea]"
        raise StageError(
            f"{scene.folder / 'scene.toml'}: {key}: {first['msg']} (got {first['input']!r}); correct it"
        ) from None
