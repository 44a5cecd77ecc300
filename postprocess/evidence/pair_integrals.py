"""The pairs of vortices of two fingers: on either side of the tips, of either sense.

A pair is known by its side and by the flow between its vortices.
"""

import numpy as np
import pandas as pd
import xarray as xr

from postprocess.evidence.centreline import beside_middle, on_middle
from postprocess.evidence.fields import frame

DORSAL, VENTRAL = ("dorsal", "downward"), ("ventral", "upward")  # side, and flow between the two
FLOWS = {"downward": -1.0, "upward": 1.0}  # sign of the left vortex' circulation
# tip widths from the tip: the dorsal pair is shed, the ventral one rises by two after contact
_REACH = {"dorsal": 5.0, "ventral": 3.0}
LATE = 0.3  # s after contact: later the jet's layers are counted for the ventral pair
_LASTS = 0.02  # s: a pair has formed when it is there at every instant for so long
COLUMNS = ("time", "side", "flow", "finger", "circulation", "x", "y", "radius", "between")


def pair_integrals(plane: xr.Dataset, table: pd.DataFrame) -> pd.DataFrame:
    """`COLUMNS`, a row for every instant, side, flow and finger with a vortex.

    The strongest of the vortex `table` near the finger's tip. `between`: vertical velocity (m/s) on
    x = 0 at its height.
    """
    table = seen_whole(table)
    near = table[table["tip_distance"] <= table["side"].map(_REACH).astype(float)]
    upward = near["circulation"] * (1 - 2 * near["finger"].astype(int)) * FLOWS["upward"] > 0
    near = near.assign(flow=np.where(upward, "upward", "downward"))
    keys = ["time", "side", "flow", "finger"]
    order = near["circulation"].abs().sort_values(ascending=False).index
    rows = near.loc[order].drop_duplicates(keys).sort_values(keys, ignore_index=True)
    columns, share = beside_middle(plane["x"].values)
    y, times, between = plane["y"].values, plane["time"].values, np.empty(len(rows))
    # a table's times are rounded in its file: the plane's own, by which others select
    index = np.abs(times[None, :] - rows["time"].to_numpy(float)[:, None]).argmin(axis=1)
    rows["time"] = times[index]
    for i in np.unique(index):
        (_, v), valid = frame(plane, int(i))
        at = np.flatnonzero(index == i)
        middle = on_middle(np.where(valid, v, np.nan)[:, columns], share)
        between[at] = np.interp(rows.loc[at, "y"], y, middle)
    return rows.assign(between=between)[list(COLUMNS)]


def seen_whole(table: pd.DataFrame) -> pd.DataFrame:
    """The vortices of each finger and sense until the largest of them meets the edge of the plane.

    What is the largest from then on is another vortex, or not known.
    """
    if "at_edge" not in table:
        return table
    size = table["peak_vorticity"] * table["radius"] ** 2  # a Lamb–Oseen circulation goes with it
    kept = []
    for _, rows in table.groupby([table["finger"], np.sign(size)]):
        largest = rows.loc[size[rows.index].abs().groupby(rows["time"]).idxmax()]
        lost = largest.loc[largest["at_edge"] == 1, "time"].min()
        kept.append(rows[~(rows["time"] >= lost) & (rows["at_edge"] == 0)])
    return pd.concat(kept).sort_index() if kept else table


def pair_of(integrals: pd.DataFrame, side: str, flow: str) -> pd.DataFrame:
    """Instants at which both fingers have a vortex of a side and flow.

    Columns time, mean |circulation|, mean `between`, and x, y of the left one.
    """
    left, right = (vortex_of(integrals, side, flow, k).set_index("time") for k in (0, 1))
    left, right = (a.loc[a.index.intersection(b.index)] for a, b in ((left, right), (right, left)))
    columns = {
        "circulation": 0.5 * (left["circulation"].abs() + right["circulation"].abs()),
        "between": 0.5 * (left["between"] + right["between"]),
        "x": left["x"],
        "y": left["y"],
    }
    return pd.DataFrame(columns).reset_index()


def vortex_of(integrals: pd.DataFrame, side: str, flow: str, finger: int) -> pd.DataFrame:
    """One finger's vortex of a pair over time, with a column `track` as drawing needs it."""
    of_pair = (integrals["side"] == side) & (integrals["flow"] == flow)
    rows = integrals[of_pair & (integrals["finger"] == finger)]
    return rows.assign(track=finger).reset_index(drop=True)


def formed(times: np.ndarray, pair: pd.DataFrame, width: float) -> float | None:
    """The first of `times` (n, s) from which a pair is there at every instant for 20 ms, or None.

    None, too, of a pair that is there at the first instant: when it formed is not known.
    One that moves by a tip `width` (m) or more between two instants is another pair.
    """
    at = pair.set_index("time").reindex(times)
    moved = np.hypot(at["x"].diff(), at["y"].diff())
    start = None
    for time, there, step in zip(times, at["x"].notna(), moved, strict=True):
        start = None if not there else time if start is None or step >= width else start
        if start is not None and time - start >= _LASTS - 1e-9:
            return float(start) if start > times[0] else None
    return None
