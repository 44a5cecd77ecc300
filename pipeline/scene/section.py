"""What every table of a scene shares: frozen, no unknown keys, no infinities; how one that is wrong is told."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

# strict: a number in quotes is no number
Number = Annotated[float, Field(strict=True)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Whole = Annotated[int, Field(strict=True)]
Count = Annotated[Whole, Field(ge=1)]
Pair = tuple[Number, Number]
LONGEST = 60  # characters of what was given, in a message


class Section(BaseModel):
    """A frozen table of numbers that refuses keys it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def validation_sentence(error: ValidationError, section: str = "") -> str:
    """The first key that is wrong in a table, below `section` where that was checked by itself, what is wrong, and what to do."""
    first = error.errors()[0]
    key = ".".join(part for part in (section, *map(str, first["loc"])) if part) or "scene"
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        message = "this key is not known; check its spelling or remove it"
    elif first["type"] == "missing":
        message = "this key is missing; add it"
    elif first["loc"]:
        given = repr(first["input"])
        message = f"{message} (got {given if len(given) <= LONGEST else given[:LONGEST] + '…'})"
    more = len(error.errors()) - 1
    return f"{key}: {message}" + (f"; and {more} more" if more else "")
