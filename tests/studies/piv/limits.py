"""PIV where it becomes worse: short waves, few particles, divergence, other windows, extremes, walls, edges, real pictures.

python -m tests.studies.piv.limits [--docs]   (make piv-limits)
Own results only, seeds 3101 and up, which served no tuning; --docs writes them into docs/piv_benchmarks.md.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
import cv2

from piv.correlation.pair import correlate_pair
from piv.synthetic.render_recording import render_pair
from tests.studies.pages import PIV, libraries, write_between
from tests.studies.piv.extremes import extremes
from tests.studies.piv.flows import SHAPE, lamb_oseen, random_field, sine, uniform
from tests.studies.piv.noise import sampling, smoothing
from tests.studies.piv.real_pictures import real_pictures
from tests.studies.piv.scores import HEAD, Errors, inner, judged, row, without_count_of_cells
from tests.studies.piv.walls import walls

FIRST = 3101


@dataclass(frozen=True)
class Limit:
    """Pairs of pictures of a flow and how they are evaluated."""

    flow: Callable
    pairs: int = 4
    render: dict[str, Any] = field(default_factory=dict)
    piv: dict[str, Any] = field(default_factory=dict)
    few: bool = True  # windows that hold few particles are told so


def drifting_vortex(x, y):
    """A vortex of 40 px in a drift, as in the pictures at the extremes (docs/stability.md)."""
    u, v = lamb_oseen(40, 2)(x, y)
    return u + 4, v


NOISY = {"noise": 0.05, "background": 5.0}
SPARSE = NOISY | {"density_ppp": 0.01}
SHIFT = uniform(4.63, -2.28)
GENERAL = random_field(3100, divergent=True)
LIMITS = {
    "sine of 32 px": Limit(sine(32, 1), 10, NOISY),
    "sine of 28 px": Limit(sine(28, 1), 10, NOISY),
    "sine of 28 px, `--window 16`": Limit(sine(28, 1), 10, NOISY, {"window": 16}),
    "sine of 24 px": Limit(sine(24, 1), 10, NOISY),
    "sine of 24 px, `--window 16`": Limit(sine(24, 1), 10, NOISY, {"window": 16}),
    **{f"uniform, `--window {w}`": Limit(SHIFT, 4, NOISY, {"window": w}) for w in (16, 20, 24, 28, 48, 64)},
    **{f"uniform, clean, `--window {w}`": Limit(SHIFT, 4, {}, {"window": w}) for w in (16, 24)},
    "uniform, `--window 24`, 0.01 ppp": Limit(SHIFT, 4, SPARSE, {"window": 24}),
    "uniform, `--window 24`, 0.002 ppp": Limit(SHIFT, 4, SPARSE | {"density_ppp": 0.002}, {"window": 24}),
    "uniform, 0.002 ppp": Limit(SHIFT, 4, SPARSE | {"density_ppp": 0.002}),
    "vortex, 0.01 ppp": Limit(drifting_vortex, 4, SPARSE),
    "vortex, 0.01 ppp, `--no-smoothing`": Limit(drifting_vortex, 4, SPARSE, {"smoothing": False}),
    "the same without the count of cells (6)": Limit(
        drifting_vortex, 4, SPARSE, {"smoothing": False}, few=False
    ),
    "random field with divergence": Limit(GENERAL, 4, NOISY),
    "random field with divergence, `--no-smoothing`": Limit(GENERAL, 4, NOISY, {"smoothing": False}),
}


def measured(limit: Limit) -> list[Errors]:
    """Those of each pair."""
    parts = []
    for seed in range(FIRST, FIRST + limit.pairs):
        pair = render_pair(limit.flow, SHAPE, seed=seed, **limit.render)
        with nullcontext() if limit.few else without_count_of_cells():
            parts.append(judged(correlate_pair(*pair, **limit.piv), limit.flow, inner(SHAPE)))
    return parts


def table() -> str:
    """Every limit as a row."""
    lines = [f"| pictures | pairs | {HEAD.replace('|---|', '|---|---|', 1)}"]
    lines += [f"| {label} | {limit.pairs} | {row(measured(limit))}" for label, limit in LIMITS.items()]
    return "\n".join(lines)


def main() -> None:
    """Measure, print, and write to the docs where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--docs", action="store_true", help="write what is found into docs/piv_benchmarks.md")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    lines = [
        table(),
        "",
        extremes(FIRST),
        "",
        walls(FIRST),
        "",
        smoothing(FIRST + 100),
        sampling(),
        real_pictures(),
    ]
    text = "\n".join([*lines, "", f"Seeds from {FIRST}; {libraries()}."])
    print(text)
    if args.docs:
        write_between(PIV, "limits", text)


if __name__ == "__main__":
    main()
