"""The water's load on a finger in the sheet as a quantity of two sources."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from piv.momentum.outline import line_loads

_LOADS: tuple[tuple[str, str, dict[str, int]], ...] = (
    ("moment", "line_moment", {}),
    ("force_x", "line_force", {"axis": 0}),
    ("force_y", "line_force", {"axis": 1}),
)


def loads_of_sheet(sheet: xr.Dataset, measured: xr.Dataset) -> xr.Dataset:
    """`piv.line_loads` of the simulation's sheet, about the point of the measured loads."""
    x, y = measured.attrs["moment_about"]
    return line_loads(sheet, (float(x), float(y)), float(measured.attrs["density"]))


def load_table(measured: xr.Dataset, simulated: xr.Dataset, finger: int = 0) -> pd.DataFrame:
    """Loads of both sources over their common time: `time`, `moment_piv`, `_piv_std`, `_cfd`, ….

    measured: a series of `piv pressure`, of a laboratory or of the virtual recording, in the
    simulation's frame and clock. simulated: `loads_of_sheet`, interpolated by lines in time. The
    moment, N m per metre across the sheet, and `force_x`, `force_y`, N/m. Comparable where the
    measured sheet is the simulation's plane of symmetry. ValueError where the measured series has
    no loads, or times do not overlap.
    """
    if "line_moment" not in measured:
        raise ValueError("no loads in the measured series: its vectors have no outline")
    times, clock = measured["time"].values, simulated["time"].values
    times = times[(times >= clock[0]) & (times <= clock[-1])]
    if not len(times):
        raise ValueError("the measured loads and the simulation have no common time")
    found = measured.sel(time=times)
    table = pd.DataFrame({"time": times})
    for name, variable, part in _LOADS:
        part = {"finger": finger} | part
        table[f"{name}_piv"] = found[variable].isel(part).values
        table[f"{name}_piv_std"] = found[f"{variable}_std"].isel(part).values
        table[f"{name}_cfd"] = np.interp(times, clock, simulated[variable].isel(part).values)
    return table
