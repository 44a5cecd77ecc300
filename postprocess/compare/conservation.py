"""Conservation as a check of a pinch's CFD: circulation and impulse against walls and forces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from postprocess.evidence.conservation import half_circulation, running_integral, vertical_impulse

NEEDED = {"p", "outline_velocity"}


def conservation(plane: xr.Dataset, scene: dict[str, Any], forces: pd.DataFrame) -> pd.DataFrame:
    """Columns of `half_circulation`, and `impulse` and `given` (m³/s).

    The impulse is that of the plane flow, `given` that of the fingers' `forces` per width.
    """
    density, viscosity = scene["fluid"]["density"], scene["fluid"]["kinematic_viscosity"]
    time, width = forces["time"].to_numpy(), scene["finger"]["width"]
    given = -2 * running_integral(forces["fy"].to_numpy(), time) / (density * width)
    table = half_circulation(plane, density, viscosity)
    return table.assign(
        impulse=vertical_impulse(plane), given=np.interp(table["time"], time, given)
    )


def conservation_numbers(
    table: pd.DataFrame, met: float | None, flat: bool
) -> dict[str, float | None]:
    """The unexplained part of circulation, before and after contact (s), and of impulse.

    The impulse only of a `flat` (2-D) flow: one plane does not tell that of a vortex loop.
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
