"""What a comparison is judged from: both sides, their motions, and the effects of other runs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
import xarray as xr

from fileio.formats.kinematics import Kinematics
from fileio.formats.plane_series import usable
from piv.vortices.find import VortexSettings
from postprocess.lab.data.files import Registration


@dataclass(frozen=True)
class Effect:
    """What one run beside the nominal one changes.

    `table`: change of the measures at each instant; `bend` (rad) and `duration` (s): of the motion.
    `per_std`: the part of it that is one standard uncertainty.
    """

    name: str
    kind: str
    how: str
    per_std: float
    table: pd.DataFrame
    bend: float
    duration: float

    def moves(self, columns: tuple[str, ...], rows: np.ndarray) -> np.ndarray:
        """Mean change of `columns` over the instants `rows`, (component,)."""
        return self.table.loc[rows, list(columns)].mean().to_numpy(float)

    def std(self, columns: tuple[str, ...], rows: np.ndarray) -> np.ndarray:
        """Standard uncertainty of the mean of `columns` over the instants `rows`, (component,).

        Of finer numerics the scatter adds: a difference that is small by chance is no small error.
        """
        moves, chosen = self.moves(columns, rows), self.table.loc[rows, list(columns)]
        if self.kind == "input":
            return self.per_std * np.abs(moves)
        scatter = chosen.std().to_numpy(float) / np.sqrt(chosen.count().to_numpy(float))
        return np.hypot(self.per_std * np.hypot(moves, scatter), scatter)


@dataclass(frozen=True)
class MotionPart:
    """Difference of the recording's motion, as a `share` of what the run `effect` changes.

    `std`: of the share, by the registration; `unlike`: its distance from the run's motion,
    relative to the nominal one.
    """

    effect: Effect
    share: float
    std: float
    unlike: float


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
    motion: list[MotionPart] = field(default_factory=list)  # where runs tell its effect

    def seen(self) -> np.ndarray:
        """Vectors (time, y, x) that may be integrated.

        Without pictures those of all sides, since programs mask the body differently; else all.
        """
        if self.registration.times.size:
            return np.ones(self.data["valid"].shape, bool)
        sides = [side for side in (self.data, self.virtual, self.direct) if side is not None]
        return np.asarray(np.logical_and.reduce([usable(side).values for side in sides]))

    @property
    def finer(self) -> list[Effect]:
        """The runs of finer numerics: what they change is added to the simulation."""
        return [e for e in self.effects if e.kind == "numerical"]

    def effect(self, name: str) -> Effect | None:
        """The effect of one run; None where it was not made."""
        return next((e for e in self.effects if e.name == name), None)
