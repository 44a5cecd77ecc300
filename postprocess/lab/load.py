"""The water's moment on the finger in the sheet, from the pressure that the vectors give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import xarray as xr

from piv.momentum.outline import line_loads
from piv.momentum.pressure import Balance
from postprocess.lab.motion import Case
from postprocess.lab.virtual_experiment import Sides

MOST = 30  # instants, each of which takes a third of a second
SHARE = 1 / 5  # of the tip's width that it may move between two fields (docs/piv_pressure.md)


def with_load(
    sides: Sides, case: Case, sheet: xr.Dataset, density: float, viscosity: float
) -> Sides:
    """Both sides with their moment (N m per metre across the sheet) about the root, over time.

    `sheet`: the simulation's in the tank frame, whose own pressure gives the direct one. Where the
    rate does not allow a pressure, `no_load` says so. Density kg/m³, kinematic viscosity m²/s.
    """
    moved = np.linalg.norm(np.diff(sides.data["tip"].values[:, 0], axis=0), axis=-1).max()
    if moved > (most := SHARE * case.kinematics.tip_width):
        return replace(
            sides,
            no_load="The moment of the water is not compared: between two fields the tip moves by"
            f" up to {1e3 * moved:.1f} mm, with {1e3 * most:.1f} mm allowed.",
        )
    root, load = case.kinematics.root, {}
    x, y = case.registration.pose.to_camera(np.array(root))
    count = sides.data.sizes["time"]
    at = np.unique(np.linspace(0, count - 1, min(count, MOST)).round().astype(int))
    for name, plane in (("data", sides.data), ("virtual", sides.virtual)):
        balance = Balance(plane, density, viscosity, (float(x), float(y)))
        found = [balance.at(k) for k in at]
        values = {"load": "line_moment", "load_random_std": "line_moment_std"}
        table = pd.DataFrame({to: [one[of][0] for one in found] for to, of in values.items()}, at)
        load[name] = table.reindex(range(count))
    own = load_of_sheet(sheet, root, density, sides.direct["time"].values)
    return replace(sides, load=load | {"direct": pd.DataFrame({"load": own})})


def load_of_sheet(
    sheet: xr.Dataset, root: tuple[float, float], density: float, times: np.ndarray
) -> np.ndarray:
    """The moment by the simulation's own pressure, of a tank-frame sheet, at `times` (s)."""
    moment = line_loads(sheet, root, density)["line_moment"].values[:, 0]
    return np.interp(times, sheet["time"].values, moment)
