"""Flows that served no tuning, and where PIV becomes worse: short waves, few particles, walls.

Own results only, seeds 2001 and 3101 and up, which served no tuning.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from docs.evidence.piv.flows import CENTRE, SHAPE, lamb_oseen, random_field, sine, uniform
from docs.evidence.piv.pages import libraries, write_study
from docs.evidence.piv.pairs import render_pair
from docs.evidence.piv.scores import EDGE, Errors, inner, joined, judged, rms, told
from docs.evidence.piv.walls import walls
from piv.correlation.pair import correlate_pair

FIRST, UNSEEN_FIRST = 3101, 2001
WALL = 200.0  # px above the bottom row: the body beside which the boundary layer flows


@dataclass(frozen=True)
class Limit:
    """Pairs of pictures of a flow and how they are evaluated."""

    flow: Callable
    pairs: int = 4
    render: dict[str, Any] = field(default_factory=dict)
    piv: dict[str, Any] = field(default_factory=dict)
    wall: float = 0.0  # px above the bottom row: a body up to there is masked


def stagnation(x, y):
    """Plane stagnation point, 0.012 px/px."""
    return 0.012 * (x - CENTRE[0]), -0.012 * (y - CENTRE[1])


def taylor_green(x, y):
    """Taylor-Green array of 180 px wavelength, 3 px strong."""
    k = 2 * np.pi / 180
    return 3 * np.sin(k * x) * np.cos(k * y), -3 * np.cos(k * x) * np.sin(k * y)


def merging(x, y):
    """Two like vortices of 30 px core radius, 90 px apart, in a drift."""
    one = lamb_oseen(30, 4, (CENTRE[0] - 45, CENTRE[1]))(x, y)
    two = lamb_oseen(30, 4, (CENTRE[0] + 45, CENTRE[1]))(x, y)
    return one[0] + two[0] + 2.3, one[1] + two[1] + 0.4


def boundary_layer(x, y):
    """Laminar-like layer 25 px thick over a body."""
    return 5 * -np.expm1(-np.maximum(y - WALL, 0) / 25), 0 * x


def drifting_vortex(x, y):
    """A vortex of 40 px in a drift, as in the pictures at the extremes (docs/stability.md)."""
    u, v = lamb_oseen(40, 2)(x, y)
    return u + 4, v


NOISY = {"noise": 0.05, "background": 5.0}
SPARSE = NOISY | {"density_ppp": 0.01}
SHIFT = uniform(4.63, -2.28)
GENERAL = random_field(3100)
LIMITS = {
    "sine of 32 px": Limit(sine(32, 1), 10, NOISY),
    "sine of 28 px": Limit(sine(28, 1), 10, NOISY),
    "sine of 28 px, `--window 16`": Limit(sine(28, 1), 10, NOISY, {"window": 16}),
    "sine of 24 px": Limit(sine(24, 1), 10, NOISY),
    "sine of 24 px, `--window 16`": Limit(sine(24, 1), 10, NOISY, {"window": 16}),
    **{
        f"uniform, `--window {w}`": Limit(SHIFT, 4, NOISY, {"window": w})
        for w in (16, 20, 24, 28, 48, 64)
    },
    **{f"uniform, clean, `--window {w}`": Limit(SHIFT, 4, {}, {"window": w}) for w in (16, 24)},
    "uniform, `--window 24`, 0.01 ppp": Limit(SHIFT, 4, SPARSE, {"window": 24}),
    "uniform, `--window 24`, 0.002 ppp": Limit(
        SHIFT, 4, SPARSE | {"density_ppp": 0.002}, {"window": 24}
    ),
    "uniform, 0.002 ppp": Limit(SHIFT, 4, SPARSE | {"density_ppp": 0.002}),
    "vortex, 0.01 ppp": Limit(drifting_vortex, 4, SPARSE),
    "vortex, 0.01 ppp, `--no-smoothing`": Limit(drifting_vortex, 4, SPARSE, {"smoothing": False}),
    "random field with divergence": Limit(GENERAL, 4, NOISY),
    "random field with divergence, `--no-smoothing`": Limit(
        GENERAL, 4, NOISY, {"smoothing": False}
    ),
}
UNSEEN = {
    "stagnation point": Limit(stagnation, 3, NOISY),
    "Taylor-Green, 180 px": Limit(taylor_green, 3, NOISY),
    "merging vortices": Limit(merging, 3, NOISY),
    "boundary layer beside a mask": Limit(boundary_layer, 3, NOISY, wall=WALL),
}


def measured(limit: Limit, first: int) -> list[Errors]:
    """Those of the inner vectors of each pair; beside a body also of the ones next to it."""
    rows = np.arange(SHAPE[0])[:, None] > SHAPE[0] - 1 - limit.wall
    mask = np.broadcast_to(rows, SHAPE) if limit.wall else None

    def counts(x, y):
        return inner(SHAPE)(x, np.maximum(y, EDGE) if limit.wall else y) & (y > limit.wall)

    parts = []
    for seed in range(first, first + limit.pairs):
        a, b = render_pair(limit.flow, SHAPE, seed=seed, **limit.render)
        if mask is not None:
            a, b = (np.where(mask, 5, image).astype(image.dtype) for image in (a, b))
        field = correlate_pair(a, b, mask=mask, **limit.piv)
        parts.append(judged(field, limit.flow, counts))
    return parts


def table(limits: dict[str, Limit], first: int) -> pd.DataFrame:
    """Every limit as a row."""
    rows = []
    for label, limit in limits.items():
        parts = measured(limit, first)
        error = {"RMS error, px": f"{rms(joined(parts).e):.4f}"}
        rows.append({"pictures": label, "pairs": limit.pairs} | error | told(parts))
    return pd.DataFrame(rows)


def study() -> None:
    """Flows that served no tuning, and the limits."""
    seeds = f"Seeds from {UNSEEN_FIRST}; {libraries()}."
    write_study("unseen", [table(UNSEEN, UNSEEN_FIRST)], seeds)
    tables = [table(LIMITS, FIRST), walls(FIRST)]
    write_study("limits", tables, f"Seeds from {FIRST}; {libraries()}.")
