"""The water's effect on the finger: motion, loads along it, and energy."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy import ndarray

from postprocess.draw.series import Curve, Panels, over_time
from postprocess.draw.style import CFD, GREY, INK, MM, PIV, THIRD

_GROUP = 4  # slices of the chain drawn as one
_NOTHING = 0.01  # of the largest energy: not drawn
_TALL = 7.6  # inches: three panels
_ENERGIES = {
    "pressure_work": ("by pressure", CFD, "-"),
    "water_work": ("by water", PIV, "-"),
    "weight_work": ("by weight", THIRD, "-"),
    "elastic_energy": ("in bending", INK, "--"),
    "kinetic_energy": ("in motion", GREY, "--"),
    "damping_loss": ("in damping", GREY, ":"),
}


def water_on_finger(loads: xr.Dataset) -> Figure:
    """Bend, loads along the finger and energies of a loads.h5 over time."""
    time, coupled = loads["step"].values, bool(loads.attrs["coupled"])
    dry, wet = ("no load", "coupled, as run") if coupled else ("as run", "in modelled water")
    as_run, other = (CFD, "-"), (GREY, "--")
    motions = (
        ("_unloaded", (dry, *(other if coupled else as_run))),
        ("_in_air", ("in air", PIV, "-.")),
        ("_in_water", (wet, *(as_run if coupled else other))),
    )
    bends = [Curve(time, np.degrees(loads[f"bend{n}"].values), *more) for n, more in motions]
    least = _NOTHING * max(np.abs(loads[name].values).max() for name in _ENERGIES)
    energies = [
        Curve(time, loads[name].values * 1e3, *more)
        for name, more in _ENERGIES.items()
        if np.abs(loads[name].values).max() > least
    ]
    panels: Panels = [("bend, °", bends), ("along the\nfinger, mm", []), ("energy, mJ", energies)]
    figure = over_time(panels, _TALL)
    axes = list(figure.axes)
    arc, load = _over_groups(loads["arc"].values, loads["force"].values[..., 1])
    size = float(np.quantile(np.abs(load), 0.995)) or 1.0  # an impact would hide the rest
    grid = axes[1].pcolormesh(
        loads["time"], arc * MM, load.T, cmap="PuOr_r", vmin=-size, vmax=size, rasterized=True
    )
    axes[1].set(ylim=(0.0, float(arc[-1]) * MM))
    axes[1].grid(False)
    label = "load of the water, N/m\n(orange: to the ventral side)"
    figure.colorbar(grid, ax=axes, label=label, shrink=0.3, aspect=15, pad=0.01)
    return figure


def _over_groups(arc: ndarray, force: ndarray) -> tuple[ndarray, ndarray]:
    """Middles (group,) m and N/m (time, group) of _GROUP slices: one is as short as a face."""
    starts = np.arange(0, len(arc), _GROUP)
    count = np.diff(np.append(starts, len(arc)))
    length = np.add.reduceat(np.gradient(arc), starts)
    return np.add.reduceat(arc, starts) / count, np.add.reduceat(force, starts, axis=1) / length
