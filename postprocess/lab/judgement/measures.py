"""Tip vortex of a plane series over time, and its uncertainty from that of the vectors."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from fileio.errors import StageError
from fileio.formats.plane_series import usable
from piv.vortices.table import tabulate_vortices
from postprocess.evidence import tip_vortex as tracks
from postprocess.lab.judgement.case import Case

COLUMNS = ("circulation", "x", "y")
_MORE = ("radius", *(f"{name}_random_std" for name in COLUMNS))


def measure(
    case: Case, plane: xr.Dataset, name: str, seen: np.ndarray | bool = True
) -> pd.DataFrame:
    """Circulation, centre (tank frame) and radius of the tip vortex of a camera-frame series.

    With their random standard uncertainties, over time; NaN where there is no vortex.
    Vectors that are not `seen` do not count. ValueError where no vortex is near the finger's tip.
    """
    counted = plane.drop_vars("flag", errors="ignore").assign(valid=usable(plane) & seen)
    table = tabulate_vortices(counted, case.vortices)
    table = table[table["bridged"] == 0]
    times = plane["time"].values
    track = tracks.dominant_track(table, 0, (times[0], times[-1]), name).set_index("time")
    out = track[[*COLUMNS, *_MORE]].astype(float).reindex(pd.Index(times, name="time"))
    places = case.registration.pose.from_camera(out[["x", "y"]].to_numpy())
    return out.assign(x=places[:, 0], y=places[:, 1]).reset_index()


def scatter(plane: xr.Dataset, table: pd.DataFrame, rows: np.ndarray) -> dict[str, float]:
    """Standard uncertainty of each quantity at one instant from the vectors' own.

    What grid and masks hide is alike on both sides, which are seen through the same windows.
    RMS over the instants `rows`. ValueError where the vectors carry no uncertainty.
    """
    if "u_std" not in plane:
        raise StageError(
            "the vectors carry no uncertainty (u_std, v_std); give vectors.std_px in dpiv.toml"
        )
    std = {name: table.loc[rows, f"{name}_random_std"].to_numpy(float) for name in COLUMNS}
    return {name: float(np.sqrt(np.mean(np.square(values)))) for name, values in std.items()}
