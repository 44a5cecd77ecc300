"""PIV where it becomes worse: short waves, few particles, walls, edges, real pictures.

python -m tests.studies.piv.limits [--docs]   Own results only, seeds 3101 and up,
which served no tuning; --docs writes them into docs/piv_benchmarks.
"""

import argparse
import os
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
import cv2
import numpy as np

from piv.correlation.pair import correlate_pair
from tests.shared_data import shared_data
from tests.studies.pages import libraries, write_study
from tests.studies.piv.flows import SHAPE, lamb_oseen, random_field, sine, uniform
from tests.studies.piv.noise import sampling, smoothing
from tests.studies.piv.pairs import render_pair
from tests.studies.piv.scores import HEAD, Errors, inner, judged, row, without_count_of_cells
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
    "the same without the count of cells (6)": Limit(
        drifting_vortex, 4, SPARSE, {"smoothing": False}, few=False
    ),
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
REAL = {
    "convection fingers (jruebsam/pypiv)": "pypiv_finger/real_ana_finger_{}.tif 0 1",
    "Kármán street (Shrediquette/PIVlab)": "pivlab_karman/PIVlab_Karman_{}.bmp 01 02",
    "16-bit pair (lento234/pivuq)": "pivuq_particledisparity/B000{}.tif 10 11",
}
ANY = 100.0  # px: no vector is less sure


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


def valid_share(a, b, limited: bool) -> float:
    """Share of valid vectors, with the uncertainty limit and the count of cells or without."""
    if limited:
        return float(correlate_pair(a, b)["valid"].mean())
    with without_count_of_cells():
        return float(correlate_pair(a, b, max_std=ANY)["valid"].mean())


def real_pictures() -> str:
    """A line of Markdown: share of valid vectors in public pairs of real pictures."""
    data, shares = shared_data(), []
    for label, files in REAL.items():
        name, *numbers = files.split()
        if data is None or not (data / name.format(numbers[0])).exists():
            shares.append(f"{label} not at hand")
            continue
        pictures = [cv2.imread(str(data / name.format(n)), cv2.IMREAD_UNCHANGED) for n in numbers]
        a, b = (i[..., 0] if i.ndim == 3 else i for i in pictures)
        shares.append(f"{label} {valid_share(a, b, True):.1%} ({valid_share(a, b, False):.1%})")
    return (
        "- Real pictures, vectors called valid (without `max_std` and the count of cells): "
        + ", ".join(shares)
        + "."
    )


def main() -> None:
    """Measure, print, and write to the docs where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--docs", action="store_true", help="write what is found into docs/piv_benchmarks"
    )
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
        write_study("limits", text)


if __name__ == "__main__":
    main()
