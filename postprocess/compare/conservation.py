"""Conservation as a check of a pinch's CFD: circulation against what the walls shed, impulse against the fingers' forces."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from fileio.formats.records import FORCES
from postprocess.evidence.conservation import half_circulation, running_integral, vertical_impulse
from postprocess.evidence.stage_files import StageFiles

NEEDED = {"p", "outline_velocity"}


def conservation(files: StageFiles, plane: xr.Dataset) -> pd.DataFrame:
    """Columns of `half_circulation`, and `impulse` and `given` (m³/s): of the plane flow, and by the fingers' forces per width."""
    fluid, width = files.numbers.fluid, files.numbers.finger.width
    density, viscosity = fluid.density, fluid.kinematic_viscosity
    forces = FORCES.read(files.required("run/forces.csv", "run"))
    time = forces["time"].to_numpy()
    given = -2 * running_integral(forces["fy"].to_numpy(), time) / (density * width)
    table = half_circulation(plane, density, viscosity)
    return table.assign(
        impulse=vertical_impulse(plane), given=np.interp(table["time"], time, given)
    )


def conservation_numbers(
    table: pd.DataFrame, met: float | None, flat: bool
) -> dict[str, float | None]:
    """What is unexplained of the circulation before and after contact, over its peak, and of the impulse, over the given one's peak.

    The impulse only of a `flat` (2-D) flow: of a vortex loop one plane does not tell it.
    """
    explained = table[["walls", "pressure", "carried", "diffused"]].sum(axis=1)
    off = (table["circulation"] - explained).abs() / table["circulation"].abs().max()
    before = table["time"] <= (np.inf if met is None else met)
    impulse = (table["impulse"] - table["given"]).abs().max() / table["given"].abs().max()
    return {
        "circulation_unexplained": float(off[before].max()),
        "circulation_unexplained_after": None if before.all() else float(off[~before].max()),
        "impulse_unexplained": float(impulse) if flat else None,
    }
