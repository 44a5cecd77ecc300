"""Vortices at two tips by integrals of the vorticity, on either side of the tip and of either sense: no core is fitted.

Integrals hold where the two cores of a pair overlap across x = 0, where a fit tells their dipole and not the circulation of
either. A pair is told by its side and by the flow between its vortices: the dorsal pair's is downward, the ventral pair's upward.
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
# tip widths from the tip: the dorsal pair is shed, the ventral one rises by two of them in the 0.3 s after contact
REACH = {"dorsal": 5.0, "ventral": 3.0}
FLOOR = 0.1  # of tip speed over tip width: weaker vorticity is the measurement's error
LEAST = 0.05  # of tip speed times tip width: a rotating region of less circulation is a layer's, not a vortex
LATE = 0.3  # s after contact: later the layers of the jet through the residual gap are counted for the ventral pair
LASTS = 0.02  # s: a pair has formed when the same one is there at every instant of so long
COLUMNS = ("time", "side", "flow", "finger", "circulation", "x", "y", "core_radius", "between")


def pair_integrals(plane: xr.Dataset, scale: float) -> pd.DataFrame:
    """`COLUMNS`, a row for every instant, side, flow and finger with a vortex of a plane series of two fingers.

    A vortex is the largest connected region of swirling strength of its sense in its finger's half of the plane, on its side of
    the tip, in REACH of it and farther than CLEAR from a body: x, y (m) are its centroid. Round that, within CIRCLE and the same
    half, all vorticity of its sense gives `circulation` (m²/s) and `core_radius` (m, root of its mean square distance, r_c of a
    Lamb-Oseen vortex). `between`: vertical velocity (m/s) on x = 0 at its height. `scale`: velocity scale, m/s.
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
            for side, reach in REACH.items():
                there = (
                    half
                    & (np.hypot(dx, dy) <= reach * width)
                    & ((across > 0) == (side == "dorsal"))
                )
                for flow, left in FLOWS.items():
                    sense = left * (1 - 2 * finger)
                    amount = np.maximum(sense * omega * half, 0.0) * step[0] * step[1]
                    region = largest(amount * (there & (sense * swirl > 0)))
                    if region.sum() < LEAST * scale * width:
                        continue
                    cx, cy = (region @ x).sum() / region.sum(), (y @ region).sum() / region.sum()
                    off = (x - cx) ** 2 + ((y - cy) ** 2)[:, None]
                    around = amount * (off <= (CIRCLE * width) ** 2)
                    radius = np.sqrt((around * off).sum() / around.sum())
                    between = np.interp(cy, y, middle)
                    rows.append(
                        [time, side, flow, finger, sense * around.sum(), cx, cy, radius, between]
                    )
    return pd.DataFrame(rows, columns=list(COLUMNS))


def largest(amount: np.ndarray) -> np.ndarray:
    """`amount` (y, x) within the connected region of positive values that holds most of it, 0 elsewhere."""
    regions, count = ndimage.label(amount > 0)
    if count == 0:
        return np.zeros_like(amount)
    totals = ndimage.sum_labels(amount, regions, range(1, count + 1))
    return np.where(regions == 1 + int(np.argmax(totals)), amount, 0.0)


def pair_of(integrals: pd.DataFrame, side: str, flow: str) -> pd.DataFrame:
    """Instants at which both fingers have a vortex of a side and flow: time, mean |circulation|, `between`, and x, y of the left one."""
    rows = integrals[(integrals["side"] == side) & (integrals["flow"] == flow)]
    left, right = (rows[rows["finger"] == finger].set_index("time") for finger in (0, 1))
    left, right = (
        left.loc[left.index.intersection(right.index)],
        right.loc[right.index.intersection(left.index)],
    )
    mean = pd.DataFrame(
        {"circulation": 0.5 * (left["circulation"].abs() + right["circulation"].abs())}
    )
    return mean.assign(
        between=0.5 * (left["between"] + right["between"]), x=left["x"], y=left["y"]
    ).reset_index()


def vortex_of(integrals: pd.DataFrame, side: str, flow: str, finger: int) -> pd.DataFrame:
    """One finger's vortex of a pair over time, with the columns that drawing a vortex takes."""
    rows = integrals[
        (integrals["side"] == side) & (integrals["flow"] == flow) & (integrals["finger"] == finger)
    ]
    return rows.assign(track=finger).reset_index(drop=True)


def formed(times: np.ndarray, pair: pd.DataFrame, width: float) -> float | None:
    """The first of `times` (n, s) from which on a pair of `pair_of` is there at every instant for LASTS; None if never.

    One that moves by a tip width (m) or more from one instant to the next is another pair, which begins anew.
    """
    at = pair.set_index("time").reindex(times)
    moved = np.hypot(at["x"].diff(), at["y"].diff())
    start = None
    for time, there, step in zip(times, at["x"].notna(), moved, strict=True):
        start = None if not there else time if start is None or step >= width else start
        if start is not None and time - start >= LASTS - 1e-9:
            return float(start)
    return None
