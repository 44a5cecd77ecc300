"""PIV where it becomes worse: short waves, few particles, walls.

python -m tests.studies.piv.limits [--docs]   Own results only, seeds 3101 and up,
which served no tuning; --docs writes them into docs/piv_benchmarks.
"""

import argparse
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
import cv2
import numpy as np

from piv.correlation.pair import correlate_pair
from tests.studies.pages import libraries, write_study
from tests.studies.piv.flows import SHAPE, lamb_oseen, random_field, sine, uniform
from tests.studies.piv.pairs import render_pair
from tests.studies.piv.scores import HEAD, Errors, inner, judged, row
from tests.studies.piv.walls import walls
from tests.studies.stability import images

FIRST = 3101


@dataclass(frozen=True)
class Limit:
    """Pairs of pictures of a flow and how they are evaluated."""

    flow: Callable
    pairs: int = 4
    render: dict[str, Any] = field(default_factory=dict)
    piv: dict[str, Any] = field(default_factory=dict)


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
EXTREMES = 20  # pairs of each
CHOSEN = (
    ("seeding (ppp)", "0.001", "balanced"),
    ("seeding (ppp)", "0.001", "accurate"),
    ("exposure (peak over full scale)", "0.02", "accurate"),
    ("diameter (px)", "0.5", "balanced"),
    ("special", "other particles in the second picture", "balanced"),
)


def measured(limit: Limit) -> list[Errors]:
    """Those of each pair."""
    parts = []
    for seed in range(FIRST, FIRST + limit.pairs):
        pair = render_pair(limit.flow, SHAPE, seed=seed, **limit.render)
        parts.append(judged(correlate_pair(*pair, **limit.piv), limit.flow, inner(SHAPE)))
    return parts


def table() -> str:
    """Every limit as a row."""
    lines = [f"| pictures | pairs | {HEAD.replace('|---|', '|---|---|', 1)}"]
    lines += [
        f"| {label} | {limit.pairs} | {row(measured(limit))}" for label, limit in LIMITS.items()
    ]
    return "\n".join(lines)


def extremes(first: int) -> str:
    """Markdown table of pictures of docs/stability.md at the limit; seeds from `first`."""
    rows, columns = images.SHAPE
    lines = [
        f"| pictures of {columns} × {rows} px (docs/stability.md) | preset | pairs | called valid "
        f"| of those wrong by over {images.WRONG_PX} px "
        f"| in the worst pair | pairs over {images.MAX_UNFLAGGED:.0%} |",
        "|---|---|---|---|---|---|---|",
    ]
    for axis, value, preset in CHOSEN:
        case = next(c for c in images.cases() if (c.axis, c.value) == (axis, value))
        scores = [images.run_case(case, preset, seed) for seed in range(first, first + EXTREMES)]
        valid, wrong = (
            np.array([r[name] for r in scores]) for name in ("valid", "wrong_unflagged")
        )
        label = value if axis == "special" else f"{axis} {value}"
        # of other particles all that are valid are wrong, and counted as a share of all vectors
        mean = wrong.mean() if case.unlike else np.sum(valid * wrong) / max(np.sum(valid), 1e-9)
        lines.append(
            f"| {label} | {preset} | {EXTREMES} | {valid.mean():.1%} | {mean:.1%} | "
            f"{wrong.max():.1%} "
            f"| {np.sum(wrong > images.MAX_UNFLAGGED)} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Measure, print, and write to the docs where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--docs", action="store_true", help="write it into docs/piv_benchmarks")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    parts = table(), extremes(FIRST), walls(FIRST), f"Seeds from {FIRST}; {libraries()}."
    text = "\n\n".join(parts)
    print(text)
    if args.docs:
        write_study("limits", text)


if __name__ == "__main__":
    main()
