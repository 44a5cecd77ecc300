"""What every table of a scene shares: frozen, no unknown keys, no infinities."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0)]
Pair = tuple[float, float]


class Section(BaseModel):
    """A frozen table of numbers that refuses keys it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
