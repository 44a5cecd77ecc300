"""The water's moment on a finger in the sheet as a quantity of two sources."""

import numpy as np
import pandas as pd
import xarray as xr

from piv.momentum.outline import line_loads


def loads_of_sheet(sheet: xr.Dataset, measured: xr.Dataset) -> xr.Dataset:
    """`piv.line_loads` of the simulation's sheet, about the point of the measured loads."""
    x, y = measured.attrs["moment_about"]
    return line_loads(sheet, (float(x), float(y)), float(measured.attrs["density"]))


def load_table(measured: xr.Dataset, simulated: xr.Dataset) -> pd.DataFrame:
    """Moments of both sources over their common time: `time`, `moment_piv`, `_piv_std`, `_cfd`.

    measured: a series of `piv pressure` in the simulation's frame and clock. simulated:
    `loads_of_sheet`, interpolated by lines in time. N m per metre across the sheet, about the root.
    Comparable where the measured sheet is the simulation's plane of symmetry.
    """
    times, clock = measured["time"].values, simulated["time"].values
    times = times[(times >= clock[0]) & (times <= clock[-1])]
    found, own = measured.sel(time=times), simulated["line_moment"].values[:, 0]
    return pd.DataFrame(
        {
            "time": times,
            "moment_piv": found["line_moment"].values[:, 0],
            "moment_piv_std": found["line_moment_std"].values[:, 0],
            "moment_cfd": np.interp(times, clock, own),
        }
    )
