"""Images at the extremes: seeding, displacement, saturation, noise, no particles, all mask, against the exact truth.

What may never happen is a plausible wrong answer: vectors that are wrong and not marked so.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from piv.correlation.pair import correlate_pair
from tests.studies.piv.pairs import render_pair

SHAPE = (320, 384)
WRONG_PX = 0.5  # a vector that is further off than this is wrong, not merely noisy
MAX_UNFLAGGED = 0.05  # part of the vectors called valid that may be wrong
DEFAULT = {"density_ppp": 0.04, "noise": 0.02, "background": 8.0}


@dataclass(frozen=True)
class ImageCase:
    """A pair of pictures: `shift` px of uniform motion, `swirl` px of a vortex' peak, and settings of render and PIV."""

    axis: str
    value: str
    shift: float = 4.0
    swirl: float = 2.0
    render: dict[str, Any] = field(default_factory=dict)
    piv: dict[str, Any] = field(default_factory=dict)
    masked: str = ""  # "half" or "all"
    unlike: bool = False  # the second picture shows other particles


def cases() -> list[ImageCase]:
    """Every picture of the study."""
    pictures = [ImageCase("seeding (ppp)", f"{d:g}", render={"density_ppp": d}) for d in (0.001, 0.005, 0.01, 0.02, 0.04, 0.1, 0.2)]  # fmt: skip
    pictures += [ImageCase("displacement (px)", f"{s:g}", shift=s, swirl=min(2.0, s / 2)) for s in (0.1, 0.5, 2, 8, 12, 16, 20, 30)]  # fmt: skip
    pictures += [ImageCase("exposure (peak over full scale)", f"{p:g}", render={"peak": p}) for p in (0.02, 0.1, 0.8, 4.0, 30.0)]  # fmt: skip
    pictures += [
        ImageCase("noise (of full scale)", f"{n:g}", render={"noise": n})
        for n in (0.0, 0.05, 0.15, 0.4)
    ]
    pictures += [
        ImageCase("diameter (px)", f"{d:g}", render={"diameter_px": d})
        for d in (0.5, 1.0, 2.5, 6.0, 15.0)
    ]
    pictures += [
        ImageCase("special", "no particles, noise", render={"density_ppp": 0.0}),
        ImageCase(
            "special",
            "no particles, black",
            render={"density_ppp": 0.0, "noise": 0.0, "background": 0.0},
        ),
        ImageCase("special", "white", render={"background": 400.0}),
        ImageCase("special", "all mask", masked="all"),
        ImageCase("special", "half mask", masked="half"),
        ImageCase("special", "other particles in the second picture", unlike=True),
    ]
    return pictures


def flow(case: ImageCase):
    """Displacement (dx, dy) in px at (x, y) px: a uniform shift and a Lamb-Oseen vortex in the middle."""
    centre, radius = np.array(SHAPE[::-1]) / 2, 40.0

    def displacement(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a, b = x - centre[0], y - centre[1]
        r2 = np.maximum(a**2 + b**2, 1e-12)
        swirl = (
            case.swirl / 0.638 * radius / np.sqrt(r2) * (1 - np.exp(-r2 / radius**2)) / np.sqrt(r2)
        )
        return case.shift - swirl * b, swirl * a

    return displacement


def run_case(case: ImageCase, preset: str, seed: int = 3) -> dict[str, Any]:
    """Render and evaluate; how it ended, and by how much it is wrong."""
    row: dict[str, Any] = {"axis": case.axis, "value": case.value, "preset": preset}
    mask = None
    if case.masked:
        mask = np.zeros(SHAPE, bool)
        mask[:, : SHAPE[1] if case.masked == "all" else SHAPE[1] // 2] = True
    settings = DEFAULT | case.render
    first, second = render_pair(flow(case), SHAPE, mask=mask, seed=seed, **settings)
    if case.unlike:
        second = render_pair(flow(case), SHAPE, mask=mask, seed=seed + 1, **settings)[1]
    try:
        plane = correlate_pair(first, second, mask=mask, preset=preset, **case.piv)
    except ValueError as error:
        return row | {"ended": "refused", "reason": " ".join(str(error).split())[:200]}
    except Exception as error:
        return row | {"ended": "CRASH", "reason": f"{type(error).__name__}: {error}"[:200]}
    x, y = np.meshgrid(plane["x"].values, plane["y"].values)
    wanted = flow(case)(x, y)
    valid = plane["valid"].values == 1
    open_water = plane["flag"].values != 2
    error = np.hypot(plane["u"].values - wanted[0], plane["v"].values - wanted[1])
    some = valid.any()
    wrong = float((error[valid] > WRONG_PX).mean()) if some else 0.0
    nothing = (
        settings["density_ppp"] == 0 or case.unlike or case.masked == "all"
    )  # no vector can be right
    if nothing:
        wrong = float(valid.sum() / max(open_water.sum(), 1))
    ended = "WRONG" if wrong > MAX_UNFLAGGED else "completed" if some else "all flagged"
    return row | {
        "ended": ended,
        "valid": round(float(valid.sum() / max(open_water.sum(), 1)), 4),
        "rms_px": round(float(np.sqrt(np.mean(np.minimum(error[valid], 10) ** 2))), 4)
        if some
        else "",
        "wrong_unflagged": round(wrong, 4),
        "reason": "",
    }
