"""What a comparison is judged from: both sides, their motions, and the effects of other runs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
import xarray as xr

from fileio.formats.kinematics import Kinematics
from piv.vortices.find import VortexSettings
from postprocess.lab.data.files import Registration


@dataclass(frozen=True)
class Effect:
    """What one run beside the nominal one changes.

    `table`: change of the measures at each instant; `bend` (rad) and `duration` (s): of the motion.
    `per_std`: the part of it that is one standard uncertainty. `share` of the change by which the
    recording's motion differs, its `share_std` by the registration, and `unlike`: distance of that
    motion from the run's, relative to the nominal one; None where this is not known.
    """

    name: str
    kind: str
    how: str
    per_std: float
    table: pd.DataFrame
    bend: float
    duration: float
    share: float | None = None
    share_std: float = 0.0
    unlike: float = 0.0

    def moves(self, columns: tuple[str, ...], rows: np.ndarray) -> np.ndarray:
        """Mean change of `columns` over the instants `rows`, (component,)."""
        return self.table.loc[rows, list(columns)].mean().to_numpy(float)

    def std(self, columns: tuple[str, ...], rows: np.ndarray) -> np.ndarray:
        """Standard uncertainty of the mean of `columns` over the instants `rows`, (component,).

        Of finer numerics by the change's RMS: where its sign changes, its mean is no small error.
        """
        if self.kind == "input":
            return self.per_std * np.abs(self.moves(columns, rows))
        change = self.table.loc[rows, list(columns)].to_numpy(float)
        return self.per_std * np.sqrt(np.mean(change**2, axis=0))


@dataclass(frozen=True)
class Case:
    """Series of the sides, motions and the effects of the runs; `virtual`: simulation by PIV."""

    kinematics: Kinematics
    registration: Registration
    data: xr.Dataset
    virtual: xr.Dataset | None
    direct: xr.Dataset
    vortices: VortexSettings
    window_m: float  # interrogation window
    geometry: bool  # whether the FEA's bands count
    bend_std: float  # rad, of the FEA at the end of the stroke
    fresh_pairs: bool  # whether every pair of the virtual experiment has particles of its own
    effects: list[Effect] = field(default_factory=list)

    @property
    def finer(self) -> list[Effect]:
        """The runs of finer numerics: what they change is added to the simulation."""
        return [e for e in self.effects if e.kind == "numerical"]

    @property
    def of_motion(self) -> list[Effect]:
        """The runs that tell what the recording's own motion changes."""
        return [e for e in self.effects if e.share is not None]
