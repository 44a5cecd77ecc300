"""The mesh intervals of a run: spans of time, each with the planform mesh that serves in it, as the mesh stage chose them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from fileio.errors import StageError
from fileio.hdf5 import read_dataset

# How long an interval is solved beside the one before it, until it has forgotten how it was started: the larger of
OVERLAP_TIME = 4e-3  # s
OVERLAP_STEPS = 8


@dataclass(frozen=True)
class Interval:
    """From `start` to `end` (s) the mesh is number `mesh` of planform.h5; not `moving`: it stands still, also in the interval's overlap."""

    index: int
    start: float
    end: float
    mesh: int
    moving: bool = True

    @property
    def name(self) -> str:
        """Its folder in case/ and its group in sweep.h5."""
        return f"interval_{self.index}"

    def begin(self, time_step: float) -> float:
        """Time (s) at which the flow is carried over and its solver starts: before `start`, but for the first interval."""
        return self.start - overlap_steps(time_step) * time_step if self.index else self.start


def overlap_steps(time_step: float) -> int:
    """Time steps of an interval's overlap: its mesh must be good from so many steps before the interval's start on."""
    return max(OVERLAP_STEPS, round(OVERLAP_TIME / time_step))


def read_intervals(out: Path) -> tuple[Interval, ...]:
    """The intervals of `planform.h5`, in order."""
    with read_dataset(out / "planform.h5", "planform") as file:
        if "interval_moving" not in file:
            raise StageError(
                f"{out / 'planform.h5'}: written by an earlier version; delete it and run make again"
            )
        columns = [file[f"interval_{name}"].values.tolist() for name in ("start", "end", "mesh", "moving")]
    rows = zip(*columns, strict=True)
    return tuple(
        Interval(k, start, end, mesh, bool(moving)) for k, (start, end, mesh, moving) in enumerate(rows)
    )


def read_planform(out: Path, mesh: int) -> xr.Dataset:
    """One planform of `planform.h5`, loaded, with the attributes that all meshes share."""
    with read_dataset(out / "planform.h5", "planform", f"mesh_{mesh}") as planform:
        return planform.load()
