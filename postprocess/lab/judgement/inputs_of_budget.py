"""What a comparison's budgets are made of: the sides, their motions, and what each run beside the nominal one changes."""

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
    """What one run beside the nominal one changes: means of `measures` over the window, the field (time, 2, y, x; of all
    instants), final bend (rad) and duration (s).

    `per_std`: its part that counts as one standard uncertainty (of the step for inputs, of the difference for numerics); `scatter`:
    standard uncertainty of `change`, from instant to instant.
    """

    name: str
    kind: str
    how: str
    per_std: float
    change: pd.Series
    scatter: pd.Series
    field: np.ndarray
    bend: float
    duration: float

    def moves(self, columns: tuple[str, ...]) -> np.ndarray:
        """Its change of the quantity that `columns` of `measures` hold, (component,)."""
        return self.change[list(columns)].to_numpy(float)

    def std(self, columns: tuple[str, ...]) -> np.ndarray:
        """Standard uncertainty of that quantity, (component,): of what is unknown the part `per_std`, and what the change scatters.

        A difference that is small by chance is no small error: it counts as large as its scatter lets it be.
        """
        scatter = self.scatter[list(columns)].to_numpy(float)
        return np.hypot(self.per_std * np.hypot(self.moves(columns), scatter), scatter)


@dataclass(frozen=True)
class MotionPart:
    """How the recording's finger moves otherwise than the simulated one, in changes of the run `effect`: `share` and its standard
    uncertainty by the registration. `unlike`: how far that motion is from the run's, relative to the nominal one."""

    effect: Effect
    share: float
    std: float
    unlike: float


@dataclass(frozen=True)
class Case:
    """All that the budgets are made of: series of the sides, the window (s), motions and the effects of the runs."""

    kinematics: Kinematics
    registration: Registration
    data: xr.Dataset
    virtual: xr.Dataset | None
    direct: xr.Dataset
    window: tuple[float, float]
    vortices: VortexSettings
    window_m: float
    geometry: bool  # whether the FEA's bands count
    bend_std: float  # rad, of the FEA at the end of the stroke
    fresh_pairs: bool  # whether every pair of the virtual experiment has particles of its own
    effects: list[Effect] = field(default_factory=list)
    measured_motion: bool = False  # whether the simulation is driven by this recording's own motion

    motion: list[MotionPart] = field(
        default_factory=list
    )  # how the recording's finger moves, where runs say what that does

    def seen(self) -> np.ndarray:
        """Vectors (time, y, x) that may be integrated. Of vectors without pictures those that every side has: their program leaves out
        others beside the body than the virtual experiment does. Of pictures all: each side's own body is masked alike.
        """
        if self.registration.times.size:
            return np.ones(self.data["valid"].shape, bool)
        sides = [
            usable(side).values
            for side in (self.data, self.virtual, self.direct)
            if side is not None
        ]
        return np.asarray(np.logical_and.reduce(sides))

    @property
    def finer(self) -> list[Effect]:
        """The runs of finer numerics: what they change is added to the simulation."""
        return [e for e in self.effects if e.kind == "numerical"]

    def effect(self, name: str) -> Effect | None:
        """The effect of one run; None where it was not made."""
        return next((e for e in self.effects if e.name == name), None)
