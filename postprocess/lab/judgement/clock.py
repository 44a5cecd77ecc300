"""Whether the water beside the finger moves as fast as the finger itself, as it must."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from fileio.errors import StageError
from fileio.formats.kinematics import Kinematics
from fileio.formats.plane_series import usable
from postprocess.lab.data.files import Registration
from postprocess.lab.judgement.case import Sides
from postprocess.lab.registration.register import law_pressure

CLEARLY = 1.15  # ratio, either way, from which a stated rate or interval is wrong
STEP = 1e-3  # s, over which the outline's velocity is taken


def clock_ratio(kinematics: Kinematics, registration: Registration, sides: Sides) -> float:
    """Speed of the recording's water within a window of the finger over that of its silhouettes.

    Relative to the same of the virtual experiment, in which boundary layer and window are alike.
    """
    assert sides.virtual is not None
    law, slopes = registration.law.values, []
    for plane, values in ((sides.data, law), (sides.virtual, np.array([1.0, law[1], 1.0]))):
        times = plane["time"].values + law[1]
        known, points = usable(plane).values, np.meshgrid(plane["x"].values, plane["y"].values)
        ends = [law_pressure(kinematics, times + s * STEP, values) for s in (-0.5, 0.0, 0.5)]
        before, now, after = (
            registration.pose.to_camera(kinematics.shape("outline", p)) for p in ends
        )
        product = square = 0.0
        for k, outline in enumerate(now):
            at = np.stack([axis[known[k]] for axis in points], axis=-1)
            away, nearest = cKDTree(outline).query(at)
            near = away < sides.window_m
            wall = ((after - before)[k] / STEP)[nearest[near]]
            water = np.stack([plane[n].values[k][known[k]][near] for n in ("u", "v")], axis=-1)
            product, square = product + np.sum(water * wall), square + np.sum(wall**2)
        slopes.append(product / square if square > 0 else np.nan)
    return float(slopes[0] / slopes[1]) if slopes[1] else np.nan


def check_clock(kinematics: Kinematics, registration: Registration, sides: Sides) -> None:
    """StageError that names the keys where the water contradicts the silhouettes."""
    if sides.virtual is None or registration.times.size == 0:
        return
    ratio = clock_ratio(kinematics, registration, sides)
    if np.isfinite(ratio) and not 1 / CLEARLY < ratio < CLEARLY:
        raise StageError(
            f"dpiv.toml: the water beside the finger moves about {ratio:.2g} times as fast as the"
            " finger in the pictures, which cannot be; frame_rate_hz (of pictures in pairs: the"
            " pairs per second) or piv.interval_s is wrong by that; correct it"
        )
