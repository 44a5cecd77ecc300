"""What a scene is judged by: planes, vortices and what follows from them, by source; and what a quantity is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
import xarray as xr

from postprocess.evidence.time_windows import Clock

Measured = float | str


@dataclass(frozen=True)
class Evidence:
    """What is compared: planes and vortex tables by source ("cfd", "piv"), the velocity scale (m/s), the motion's clock.

    `sums`: postprocess.evidence.fields.field_sums by pair of sources ("piv-cfd": PIV against the CFD). Of two fingers by source:
    `pairs` (vortex_pairs), `lines` (centreline), `integrals` (pair_integrals), `halves` (half_planes), and `single`, the vortices of
    the single finger with its `bend` (rad) at each; `single_absent` says why there are none.
    """

    planes: dict[str, xr.Dataset]
    vortices: dict[str, pd.DataFrame]
    scale: float
    clock: Clock
    sums: dict[str, pd.DataFrame] = field(default_factory=dict)
    pairs: dict[str, pd.DataFrame] = field(default_factory=dict)
    lines: dict[str, pd.DataFrame] = field(default_factory=dict)
    integrals: dict[str, pd.DataFrame] = field(default_factory=dict)
    halves: dict[str, pd.DataFrame] = field(default_factory=dict)
    single: dict[str, pd.DataFrame] = field(default_factory=dict)
    single_absent: str = ""

    def has(self, of: str) -> bool:
        """Whether every source that `of` names was run."""
        return all(source in self.planes for source in of.split("-"))


@dataclass(frozen=True)
class Part:
    """The part of the evidence that one quantity is measured on: a source or pair of sources, a window (s), a finger."""

    evidence: Evidence
    of: str
    window: tuple[float, float]
    finger: int = 0

    def inside(self, table: pd.DataFrame) -> pd.DataFrame:
        """The rows of a table over `time` that lie in the window."""
        return table[table["time"].between(*self.window)]

    def share(self, rows: int) -> float:
        """A number of instants as a part of those of the source's plane in the window."""
        times = self.evidence.planes[self.of]["time"].values
        return rows / max(
            int(np.count_nonzero((times >= self.window[0]) & (times <= self.window[1]))), 1
        )

    def words(self) -> str:
        """The window, for a message."""
        return f"between {self.window[0]:.3f} and {self.window[1]:.3f} s"


@dataclass(frozen=True)
class Quantity:
    """How a quantity is measured, its unit (SI; "fraction" is shown in per cent, "1" as it is, "" a word) and its description."""

    measure: Callable[[Part], Measured]
    unit: str
    label: str
