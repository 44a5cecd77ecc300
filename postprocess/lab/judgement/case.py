"""What a comparison is judged from: both sides, their motions, and the effects of other runs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
import xarray as xr

from fileio.formats.kinematics import Kinematics
from piv.vortices.find import VortexSettings
from postprocess.lab.data.files import Registration
from postprocess.lab.data.inputs_toml import Input, Numerics

COLUMNS = ("circulation", "x", "y")


@dataclass(frozen=True)
class Effect:
    """What one run beside the nominal one changes.

    `bend` (rad) and `duration` (s): of the motion. `table`: change of `COLUMNS` at each instant;
    None where the flow is not compared. `share` of the change by which the recording's motion
    differs, its `share_std` by the registration, and `unlike`: distance of that motion from the
    run's, relative to the nominal one; None where this is not known.
    """

    of: Input | Numerics
    bend: float
    duration: float
    table: pd.DataFrame | None = None
    share: float | None = None
    share_std: float = 0.0
    unlike: float = 0.0

    @property
    def kind(self) -> str:
        """The kind of source, as `validation.KINDS` has it."""
        return "input" if isinstance(self.of, Input) else "numerical"

    @property
    def how(self) -> str:
        """How its uncertainty was found."""
        if isinstance(self.of, Input):
            return f"run with {self.of.key} {self.of.step:+g}"
        return f"grid-convergence index of the run finer by {self.of.ratio:g}"

    def moves(self, columns: tuple[str, ...], rows: np.ndarray) -> np.ndarray:
        """Mean change of `columns` over the instants `rows`, (component,)."""
        assert self.table is not None
        return self.table.loc[rows, list(columns)].mean().to_numpy(float)

    def std(self, columns: tuple[str, ...], rows: np.ndarray) -> np.ndarray:
        """Standard uncertainty of the mean of `columns` over the instants `rows`, (component,).

        Of finer numerics by the change's RMS: where its sign changes, its mean is no small error.
        """
        if self.kind == "input":
            return self.of.per_change * np.abs(self.moves(columns, rows))
        assert self.table is not None
        change = self.table.loc[rows, list(columns)].to_numpy(float)
        return self.of.per_change * np.sqrt(np.mean(change**2, axis=0))


@dataclass(frozen=True)
class Sides:
    """Plane series in the camera frame with the same axes and times."""

    data: xr.Dataset
    virtual: xr.Dataset
    direct: xr.Dataset
    vortices: VortexSettings
    window_m: float  # interrogation window


@dataclass(frozen=True)
class Case:
    """Motions of both sides, their flows (None: not compared), and the effects of the runs."""

    kinematics: Kinematics
    registration: Registration
    bend_std: float  # rad, of the FEA at the end of the stroke; 0: its bands do not count
    flow: Sides | None = None
    effects: list[Effect] = field(default_factory=list)

    @property
    def finer(self) -> list[Effect]:
        """The runs of finer numerics: what they change is added to the simulation."""
        return [e for e in self.effects if e.kind == "numerical"]

    @property
    def of_motion(self) -> list[Effect]:
        """The runs that tell what the recording's own motion changes."""
        return [e for e in self.effects if e.share is not None]
