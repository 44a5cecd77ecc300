"""Whether the water beside the finger moves as fast as the finger itself, as it must."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from fileio.errors import StageError
from fileio.formats.kinematics import Kinematics
from fileio.formats.plane_series import usable
from postprocess.lab.data.files import Registration
from postprocess.lab.judgement.case import Sides
from postprocess.lab.registration.register import law_pressure

# Ratio, either way, from which a stated rate or interval is wrong: sound recordings of a stroke 6 %
# shorter than the simulation's have 0.84 (docs/record/laboratory.md, four seeds).
CLEARLY = 1.25
STEP = 1e-3  # s, over which the outline's velocity is taken


def clock_ratio(kinematics: Kinematics, registration: Registration, sides: Sides) -> float:
    """Speed of the recording's water within a window of the finger over that of its silhouettes.

    Relative to the same of the virtual experiment, in which boundary layer and window are alike.
    Of vectors that both have beside both fingers: where these lie apart, one hides the other's.
    """
    law, planes = registration.law.values, (sides.data, sides.virtual)
    known = np.logical_and(*(usable(plane).values for plane in planes))
    points = np.meshgrid(sides.data["x"].values, sides.data["y"].values)
    at = [np.stack([axis[one] for axis in points], axis=-1) for one in known]
    walls: list[list[np.ndarray]] = []
    beside = [np.ones(len(places), bool) for places in at]
    for plane, values in zip(planes, (law, np.array([1.0, law[1], 1.0])), strict=True):
        times = plane["time"].values + law[1]
        ends = [law_pressure(kinematics, times + s * STEP, values) for s in (-0.5, 0.0, 0.5)]
        before, now, after = (
            registration.pose.to_camera(kinematics.shape("outline", p)) for p in ends
        )
        walls.append([])
        for k, outline in enumerate(now):
            away, nearest = cKDTree(outline).query(at[k])
            beside[k] &= away < sides.window_m
            walls[-1].append(((after - before)[k] / STEP)[nearest])
    slopes = []
    for plane, wall in zip(planes, walls, strict=True):
        moved = np.concatenate([w[near] for w, near in zip(wall, beside, strict=True)])
        flow = np.stack([plane[n].values for n in ("u", "v")], axis=-1)
        water = np.concatenate([f[k][n] for f, k, n in zip(flow, known, beside, strict=True)])
        slopes.append(np.sum(water * moved) / max(np.sum(moved**2), 1e-30))
    return float(slopes[0] / slopes[1]) if slopes[1] else np.nan


def check_clock(
    kinematics: Kinematics, registration: Registration, sides: Sides, path: Path
) -> None:
    """StageError that names the keys of `path` where the water contradicts the silhouettes."""
    if registration.times.size == 0:
        return
    ratio = clock_ratio(kinematics, registration, sides)
    if np.isfinite(ratio) and not 1 / CLEARLY < ratio < CLEARLY:
        raise StageError(
            f"the water beside the finger moves about {ratio:.2g} times as fast as the"
            " finger in the pictures, which cannot be; frame_rate_hz (of pictures in pairs: the"
            " pairs per second) or piv.interval_s is wrong by about this factor; correct it in"
            f" {path}"
        )
