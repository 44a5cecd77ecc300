"""The water's effect on the finger: motion, loads along it, and energy."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from postprocess.draw.style import CFD, GREY, MM, PIV, THIRD, new_figure

_GROUP = 4  # slices of the chain drawn as one
_ENERGIES = {
    "pressure_work": ("work of the pressure", CFD, "-"),
    "water_work": ("work of the water", PIV, "-"),
    "weight_work": ("work of weight and buoyancy", THIRD, "-"),
    "elastic_energy": ("held by bending", "k", "--"),
    "kinetic_energy": ("of motion", GREY, "--"),
    "damping_loss": ("lost in the rubber", GREY, ":"),
}


def water_on_finger(loads: xr.Dataset) -> Figure:
    """Bend, tip path, loads and energies of a loads.h5."""
    figure, axes = new_figure(9.6, 7.6, 2, 2)
    time = loads["step"].values
    turn, path, across, energy = axes.ravel()
    coupled = bool(loads.attrs["coupled"])
    dry, wet = ("no load", "coupled, as run") if coupled else ("as run", "in modelled water")
    as_run, other = (CFD, "-"), (GREY, "--")
    motions = (
        ("_unloaded", dry, *(other if coupled else as_run)),
        ("_in_air", "in air", PIV, "-."),
        ("_in_water", wet, *(as_run if coupled else other)),
    )
    for name, label, colour, style in motions:
        line: dict[str, Any] = {"color": colour, "linestyle": style, "label": label}
        turn.plot(time, np.degrees(loads[f"bend{name}"]), **line)
        path.plot(*(loads[f"tip{name}"].values.T * MM), **line)
    turn.set(xlabel="time, s", ylabel="bend angle, °", title="Bend")
    path.set(xlabel="x, mm", ylabel="y, mm", title="Path of the tip's ventral edge", aspect="equal")
    arc, load = _over_groups(loads["arc"].values, loads["force"].values[..., 1])
    size = float(np.quantile(np.abs(load), 0.995)) or 1.0  # an impact would hide the rest
    grid = across.pcolormesh(loads["time"], arc * MM, load.T, cmap="PuOr_r", vmin=-size, vmax=size)
    figure.colorbar(grid, ax=across, label="N/m, towards the ventral side")
    across.set(xlabel="time, s", ylabel="along the finger, mm", title="Load of the water")
    across.grid(False)
    for name, (label, colour, style) in _ENERGIES.items():
        energy.plot(time, loads[name] * 1e3, color=colour, linestyle=style, label=label)
    energy.set(xlabel="time, s", ylabel="energy, mJ", title="Energy of the finger")
    for axis in (turn, path):
        axis.legend(loc="best", fontsize=8)
    energy.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, fontsize=8)
    return figure


def _over_groups(arc: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles (group,) m and N/m (time, group) of _GROUP slices: one is as short as a face."""
    starts = np.arange(0, len(arc), _GROUP)
    count = np.diff(np.append(starts, len(arc)))
    length = np.add.reduceat(np.gradient(arc), starts)
    return np.add.reduceat(arc, starts) / count, np.add.reduceat(force, starts, axis=1) / length
