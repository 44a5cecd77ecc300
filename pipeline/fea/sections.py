"""The sections [actuator] and [fea] of a scene, checked."""

from pydantic import ValidationError

from pipeline.fea.settings import Actuator, Fea
from pipeline.scene.scene import Scene
from pipeline.scene.section import validation_sentence
from piv.files.errors import StageError

_LENGTH_TOLERANCE = 0.02  # of finger.length: kinematics refuses states of another length


def check_length(scene: Scene, actuator: Actuator) -> None:
    """StageError where the unit cells of an actuator make no finger of the scene's length."""
    if abs(actuator.length - scene.finger.length) > _LENGTH_TOLERANCE * scene.finger.length:
        raise StageError(
            f"{scene.folder / 'scene.toml'}: [actuator] is {actuator.length:.4g} m long,"
            " chambers × (l2 + 2 l1) + (chambers − 1) × gap, but finger.length ="
            f" {scene.finger.length:g} m; change one of them, as chambers ="
            f" {round((scene.finger.length + actuator.gap) / actuator.pitch)}"
        )


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
