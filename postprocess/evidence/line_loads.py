"""The water's load on a finger in the sheet as a quantity of two sources."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from piv.momentum.outline import line_loads

# of `load_table`, N and N/m
LOADS = {"moment": "line_moment", "force_x": "line_force", "force_y": "line_force"}


def load_table(
    measured: xr.Dataset, simulated: xr.Dataset, finger: int = 0, end: float = np.inf
) -> pd.DataFrame:
    """Moment and force over the common time: `time`, `moment_piv`, `_piv_std`, `_cfd`, `force_x_…`.

    measured: a series of `piv pressure`, of a laboratory or of the virtual recording, in the
    simulation's frame and clock. simulated: the sheet of the simulation with `p`, `outline` and
    `outline_velocity`. N m per metre across the sheet about the measured series' `moment_about`,
    and N/m. The simulation's are the same integral of its own pressure, by lines in time. `end`: s,
    the last instant. ValueError where the measured series has no loads, or times do not overlap.
    """
    if "line_moment" not in measured:
        raise ValueError("no loads in the measured series: its vectors have no outline")
    about, density = measured.attrs["moment_about"], float(measured.attrs["density"])
    times = measured["time"].values
    clock = simulated["time"].values
    times = times[(times >= clock[0]) & (times <= min(end, clock[-1]))]
    if not len(times):
        raise ValueError("the measured loads and the simulation have no common time")
    own = line_loads(simulated, tuple(about), density)
    found = measured.sel(time=times)
    table = pd.DataFrame({"time": times})
    for axis, (name, variable) in enumerate(LOADS.items(), start=-1):
        part = {"finger": finger} | ({"axis": axis} if axis >= 0 else {})
        table[f"{name}_piv"] = found[variable].isel(part).values
        table[f"{name}_piv_std"] = found[f"{variable}_std"].isel(part).values
        table[f"{name}_cfd"] = np.interp(times, clock, own[variable].isel(part).values)
    return table


def relative_difference(table: pd.DataFrame, name: str = "moment") -> float:
    """RMS difference of a load between the sources, over the RMS of the simulation's."""
    other, own = table[f"{name}_piv"], table[f"{name}_cfd"]
    return float(np.sqrt(np.mean((other - own) ** 2) / np.mean(own**2)))
