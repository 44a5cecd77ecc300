"""What a scene is judged by: planes, vortices and what follows from them, by source; and what a quantity is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import pandas as pd
import xarray as xr

Window = tuple[float, float]


@dataclass(frozen=True)
class Evidence:
    """What is compared: planes and vortex tables by source ("cfd", "piv"), and the velocity scale (m/s).

    `sums` holds postprocess.evidence.fields.field_sums by pair ("piv-cfd": PIV against the CFD). Of two fingers by source: `pairs`
    (postprocess.evidence.vortex_pairs), `lines` (postprocess.evidence.centreline), and `single`, the vortices of the single finger with its `bend`
    (rad) at each; `single_absent` says what to run where that is missing. `starts`: when the motion's strokes begin (s).
    """

    planes: dict[str, xr.Dataset]
    vortices: dict[str, pd.DataFrame]
    scale: float
    sums: dict[str, pd.DataFrame] = field(default_factory=dict)
    pairs: dict[str, pd.DataFrame] = field(default_factory=dict)
    lines: dict[str, pd.DataFrame] = field(default_factory=dict)
    single: dict[str, pd.DataFrame] = field(default_factory=dict)
    single_absent: str = ""
    starts: tuple[float, ...] = ()

    def has(self, of: str) -> bool:
        """Whether every source that `of` names was run."""
        return all(source in self.planes for source in of.split("-"))


@dataclass(frozen=True)
class Quantity:
    """How a quantity is measured, its unit (SI; "fraction" is shown in per cent, "1" as it is, "" a word) and what it is in words."""

    measure: Callable[[Evidence, str, Window, int], Measured]
    unit: str
    label: str


Measured = float | str
