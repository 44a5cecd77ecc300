"""Pictures at the extremes against the exact truth: wrong vectors must never count as valid.

Axes: seeding, displacement, saturation, noise, particle size; no particles, masked pictures.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from docs.evidence.piv.pairs import render_pair
from piv.correlation.pair import correlate_pair

SHAPE = (320, 384)
WRONG_PX = 0.5  # a vector with a larger error is wrong, not merely noisy
MAX_UNFLAGGED = 0.05  # fraction of the valid vectors that may be wrong
DEFAULT = {"density_ppp": 0.04, "noise": 0.02, "background": 8.0}


@dataclass(frozen=True)
class ImageCase:
    """A pair of pictures: uniform motion and a vortex (px), and settings of the rendering."""

    axis: str
    value: str
    shift: float = 4.0
    swirl: float = 2.0  # peak of the vortex
    render: dict[str, Any] = field(default_factory=dict)
    masked: float = 0.0  # fraction of the columns
    unlike: bool = False  # the second picture shows other particles


def cases() -> list[ImageCase]:
    """Every picture of the study."""
    axes = {
        "seeding (ppp)": ("density_ppp", (0.001, 0.005, 0.01, 0.02, 0.04, 0.1, 0.2)),
        "exposure (peak over full scale)": ("peak", (0.02, 0.1, 0.8, 4.0, 30.0)),
        "noise (of full scale)": ("noise", (0.0, 0.05, 0.15, 0.4)),
        "diameter (px)": ("diameter_px", (0.5, 1.0, 2.5, 6.0, 15.0)),
    }
    pictures = []
    for axis, (key, values) in axes.items():
        pictures += [ImageCase(axis, f"{value:g}", render={key: value}) for value in values]
    pictures += [
        ImageCase("displacement (px)", f"{value:g}", value, min(2.0, value / 2))
        for value in (0.1, 0.5, 2, 8, 12, 16, 20, 30)
    ]
    black = {"density_ppp": 0.0, "noise": 0.0, "background": 0.0}
    other = "other particles in the second picture"
    return [
        *pictures,
        ImageCase("special", "no particles, noise", render={"density_ppp": 0.0}),
        ImageCase("special", "no particles, black", render=black),
        ImageCase("special", "white", render={"background": 400.0}),
        ImageCase("special", "all mask", masked=1.0),
        ImageCase("special", "half mask", masked=0.5),
        ImageCase("special", other, unlike=True),
    ]


def flow(case: ImageCase):
    """Displacement (dx, dy) at (x, y), px: a uniform shift and a Lamb-Oseen vortex."""
    centre, radius = np.array(SHAPE[::-1]) / 2, 40.0

    def displacement(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a, b = x - centre[0], y - centre[1]
        r2 = np.maximum(a**2 + b**2, 1e-12)
        swirl = case.swirl / 0.638 * radius / r2 * -np.expm1(-r2 / radius**2)
        return case.shift - swirl * b, swirl * a

    return displacement


def run_case(case: ImageCase, preset: str, seed: int = 3) -> dict[str, Any]:
    """Render and evaluate a pair; its ending and its errors."""
    row: dict[str, Any] = {"axis": case.axis, "value": case.value, "preset": preset, "reason": ""}
    mask = None
    if case.masked:
        mask = np.zeros(SHAPE, bool)
        mask[:, : int(case.masked * SHAPE[1])] = True
    settings = DEFAULT | case.render
    seeds = range(seed, seed + 1 + case.unlike)
    pairs = [render_pair(flow(case), SHAPE, mask=mask, seed=k, **settings) for k in seeds]
    try:
        plane = correlate_pair(pairs[0][0], pairs[-1][1], mask=mask, preset=preset)
    except ValueError as error:
        return row | {"ended": "refused", "reason": " ".join(str(error).split())[:200]}
    except Exception as error:
        return row | {"ended": "CRASH", "reason": f"{type(error).__name__}: {error}"[:200]}
    wanted = flow(case)(*np.meshgrid(plane["x"].values, plane["y"].values))
    valid = plane["valid"].values == 1
    part = float(valid.sum() / max((plane["flag"].values != 2).sum(), 1))
    error = np.hypot(plane["u"].values - wanted[0], plane["v"].values - wanted[1])[valid]
    wrong = float((error > WRONG_PX).mean()) if error.size else 0.0
    if settings["density_ppp"] == 0 or case.unlike or case.masked == 1:
        wrong = part  # no vector can be right
    row |= {"valid": round(part, 4), "wrong_unflagged": round(wrong, 4)}
    if not error.size:
        return row | {"ended": "all flagged", "rms_px": ""}
    rms = round(float(np.sqrt(np.mean(np.minimum(error, 10) ** 2))), 4)
    return row | {"ended": "WRONG" if wrong > MAX_UNFLAGGED else "completed", "rms_px": rms}
