"""The base of a scene's tables (frozen, no unknown keys, no infinities), and its complaints."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pipeline.scene.key_reference import complaints

# strict: a number in quotes is no number
Number = Annotated[float, Field(strict=True)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Whole = Annotated[int, Field(strict=True)]
Count = Annotated[Whole, Field(ge=1)]
Pair = tuple[Number, Number]


class Section(BaseModel):
    """A frozen table of numbers that refuses keys it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def validation_sentence(error: ValidationError, model: type[BaseModel], section: str = "") -> str:
    """All complaints about a table of a model; `section`: its name where it was checked alone."""
    return "; ".join(complaints(error.errors(), model, section)) or "scene"
