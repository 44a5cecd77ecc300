"""What a scene is judged by, by source; and what a quantity is."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
import xarray as xr

from postprocess.evidence.time_windows import Clock

Measured = float | str


@dataclass(frozen=True)
class Evidence:
    """Planes and vortex tables by source ("cfd", "piv"), the velocity scale (m/s) and the clock.

    `sums`: fields.field_sums by pair of sources ("piv-cfd"). Of two fingers by source: `pairs`
    (vortex_pairs), `lines` (centreline), `integrals` (pair_integrals), and `single`, the single
    finger's vortices with their `bend` (rad); `single_absent`: why none.
    """

    planes: dict[str, xr.Dataset]
    vortices: dict[str, pd.DataFrame]
    scale: float
    clock: Clock
    sums: dict[str, pd.DataFrame] = field(default_factory=dict)
    pairs: dict[str, pd.DataFrame] = field(default_factory=dict)
    lines: dict[str, pd.DataFrame] = field(default_factory=dict)
    integrals: dict[str, pd.DataFrame] = field(default_factory=dict)
    single: dict[str, pd.DataFrame] = field(default_factory=dict)
    single_absent: str = ""

    def has(self, of: str) -> bool:
        """Whether every source that `of` names was run."""
        return all(source in self.planes for source in of.split("-"))


@dataclass(frozen=True)
class Part:
    """Where one quantity is measured: source or pair of sources, window (s), finger."""

    evidence: Evidence
    of: str
    window: tuple[float, float]
    finger: int = 0

    def inside(self, table: pd.DataFrame) -> pd.DataFrame:
        """The rows of a table over `time` that lie in the window."""
        return table[table["time"].between(*self.window)]

    def share(self, rows: int) -> float:
        """A number of instants as a part of those of the source's plane in the window."""
        times, (start, end) = self.evidence.planes[self.of]["time"].values, self.window
        return rows / max(int(np.count_nonzero((times >= start) & (times <= end))), 1)

    def words(self) -> str:
        """Describe the window for a message."""
        return f"between {self.window[0]:.3f} and {self.window[1]:.3f} s"


@dataclass(frozen=True)
class Quantity:
    """How a quantity is measured, its SI unit ("fraction", "1", or "" for a word) and its label.

    `known`: at how many instants of how many it can be judged; None: at all.
    """

    measure: Callable[[Part], Measured]
    unit: str
    label: str
    known: Callable[[Part], tuple[int, int]] | None = None
