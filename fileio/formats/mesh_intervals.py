"""The legs of a run: parts of the time in which one planform serves, as the mesh stage planned them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from fileio.errors import StageError
from fileio.hdf5 import read_dataset

# How long a leg is solved beside the one before it, until it has forgotten how it was started: the larger of
RUN_IN_TIME = 4e-3  # s
RUN_IN_STEPS = 8


@dataclass(frozen=True)
class Leg:
    """From `start` to `end` (s) the mesh is that of `stage`; not `moving`: it stands still, also in the leg's run-in."""

    index: int
    start: float
    end: float
    stage: int
    moving: bool = True

    @property
    def name(self) -> str:
        """Its folder in case/ and its group in sweep.h5."""
        return f"leg_{self.index}"

    def begin(self, time_step: float) -> float:
        """Time (s) at which the flow is carried over and its solver starts: before `start`, but for the first leg."""
        return self.start - run_in_steps(time_step) * time_step if self.index else self.start


def run_in_steps(time_step: float) -> int:
    """Time steps of a leg's run-in: its mesh must be good from so many steps before the leg's start on."""
    return max(RUN_IN_STEPS, round(RUN_IN_TIME / time_step))


def read_legs(out: Path) -> tuple[Leg, ...]:
    """The legs of `planform.h5`, in order."""
    with read_dataset(out / "planform.h5", "planform") as file:
        if "leg_moving" not in file:
            raise StageError(
                f"{out / 'planform.h5'}: written by an earlier version; delete it and run make again"
            )
        columns = [file[f"leg_{name}"].values.tolist() for name in ("start", "end", "stage", "moving")]
    rows = zip(*columns, strict=True)
    return tuple(
        Leg(k, start, end, stage, bool(moving)) for k, (start, end, stage, moving) in enumerate(rows)
    )


def read_stage(out: Path, stage: int) -> xr.Dataset:
    """One planform of `planform.h5`, loaded, with the attributes that all of them share."""
    with read_dataset(out / "planform.h5", "planform", f"stage_{stage}") as planform:
        return planform.load()
