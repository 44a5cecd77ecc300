"""Vortices at two tips by integrals of the vorticity, on either side of the tip, of either sense.

Integrals hold where the two cores of a pair overlap across x = 0; a fit then sees their dipole. A
pair is known by its side and by the flow between its vortices.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from scipy import ndimage

from piv.vortices.circulation import distance_to_invalid
from piv.vortices.criteria import gradients, swirling_strength, vorticity
from postprocess.evidence.centreline import beside_middle, halves_of, on_middle
from postprocess.evidence.fields import frame
from postprocess.evidence.vortex_integral import CIRCLE, CLEAR

DORSAL, VENTRAL = ("dorsal", "downward"), ("ventral", "upward")  # side, and flow between the two
FLOWS = {"downward": -1.0, "upward": 1.0}  # sign of the left vortex' circulation
# tip widths from the tip: the dorsal pair is shed, the ventral one rises by two after contact
_REACH = {"dorsal": 5.0, "ventral": 3.0}
FLOOR = 0.1  # of tip speed over tip width: weaker vorticity is the measurement's error
LEAST = 0.05  # of tip speed times tip width: a region of less circulation is a layer, no vortex
LATE = 0.3  # s after contact: later the jet's layers are counted for the ventral pair
_LASTS = 0.02  # s: a pair has formed when it is there at every instant for so long
COLUMNS = ("time", "side", "flow", "finger", "circulation", "x", "y", "core_radius", "between")


def pair_integrals(plane: xr.Dataset, scale: float) -> pd.DataFrame:
    """`COLUMNS`, a row for every instant, side, flow and finger with a vortex.

    A vortex is the largest connected region of swirling strength of its sense in its finger's half
    of the plane, on its side of the tip, near it and farther than CLEAR from a body: x, y (m) are
    its centroid. Round that, within CIRCLE and the same half, all vorticity of its sense gives
    `circulation` (m²/s) and `core_radius` (m, its root mean square distance, r_c of a Lamb-Oseen
    vortex). `between`: vertical velocity (m/s) on x = 0 at its height. `scale`: m/s.
    """
    x, y, width = plane["x"].values, plane["y"].values, float(plane.attrs["tip_width"])
    step = float(x[1] - x[0]), float(y[1] - y[0])
    columns, share = beside_middle(x)
    tips, dorsal = plane["tip"].values, plane["dorsal_direction"].values
    rows = []
    for index, time in enumerate(plane["time"].values):
        (u, v), valid = frame(plane, index)
        g = gradients(u, v, valid, *step)
        free = distance_to_invalid(valid, *step) > CLEAR * width
        omega, swirl = (
            np.where(free, np.nan_to_num(q), 0.0) for q in (vorticity(g), swirling_strength(g))
        )
        omega[np.abs(omega) < FLOOR * scale / width] = 0.0
        middle = on_middle(np.where(valid, v, np.nan)[:, columns], share)
        for finger, half in enumerate(halves_of(x)):
            dx, dy = x - tips[index, finger, 0], (y - tips[index, finger, 1])[:, None]
            across = dx * dorsal[index, finger, 0] + dy * dorsal[index, finger, 1]
            for side, reach in _REACH.items():
                there = half & (np.hypot(dx, dy) <= reach * width)
                there &= (across > 0) == (side == "dorsal")
                for flow, left in FLOWS.items():
                    sense = left * (1 - 2 * finger)
                    amount = np.maximum(sense * omega * half, 0.0) * step[0] * step[1]
                    region = _largest(amount * (there & (sense * swirl > 0)))
                    if region.sum() < LEAST * scale * width:
                        continue
                    cx, cy = (region @ x).sum() / region.sum(), (y @ region).sum() / region.sum()
                    off = (x - cx) ** 2 + ((y - cy) ** 2)[:, None]
                    around = amount * (off <= (CIRCLE * width) ** 2)
                    radius = np.sqrt((around * off).sum() / around.sum())
                    place = cx, cy, radius, np.interp(cy, y, middle)
                    rows.append([time, side, flow, finger, sense * around.sum(), *place])
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _largest(amount: np.ndarray) -> np.ndarray:
    """`amount` (y, x) within the connected region that holds most of it, 0 elsewhere."""
    regions, count = ndimage.label(amount > 0)
    if count == 0:
        return np.zeros_like(amount)
    totals = ndimage.sum_labels(amount, regions, range(1, count + 1))
    return np.where(regions == 1 + int(np.argmax(totals)), amount, 0.0)


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

    One that moves by a tip `width` (m) or more between two instants is another pair.
    """
    at = pair.set_index("time").reindex(times)
    moved = np.hypot(at["x"].diff(), at["y"].diff())
    start = None
    for time, there, step in zip(times, at["x"].notna(), moved, strict=True):
        start = None if not there else time if start is None or step >= width else start
        if start is not None and time - start >= _LASTS - 1e-9:
            return float(start)
    return None
