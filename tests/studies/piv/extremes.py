"""Pictures at the extremes with seeds that served no tuning: those of docs/stability.md that a limit of uncertainty decides on."""

from __future__ import annotations

import numpy as np

from tests.studies.stability import images

PAIRS = 20
CHOSEN = (
    ("seeding (ppp)", "0.001", "balanced"),
    ("seeding (ppp)", "0.001", "accurate"),
    ("exposure (peak over full scale)", "0.02", "accurate"),
    ("diameter (px)", "0.5", "balanced"),
    ("special", "other particles in the second picture", "balanced"),
)


def extremes(first: int) -> str:
    """Markdown table; seeds from `first`."""
    rows, columns = images.SHAPE
    lines = [
        f"| pictures of {columns} × {rows} px (docs/stability.md) | preset | pairs | called valid | of those wrong by over {images.WRONG_PX} px "
        f"| in the worst pair | pairs over {images.MAX_UNFLAGGED:.0%} |",
        "|---|---|---|---|---|---|---|",
    ]
    for axis, value, preset in CHOSEN:
        case = next(c for c in images.cases() if (c.axis, c.value) == (axis, value))
        scores = [images.run_case(case, preset, seed) for seed in range(first, first + PAIRS)]
        valid, wrong = (np.array([r[name] for r in scores]) for name in ("valid", "wrong_unflagged"))
        label = value if axis == "special" else f"{axis} {value}"
        # of other particles all that are valid are wrong, and counted as a share of all vectors
        mean = wrong.mean() if case.unlike else np.sum(valid * wrong) / max(np.sum(valid), 1e-9)
        lines.append(
            f"| {label} | {preset} | {PAIRS} | {valid.mean():.1%} | {mean:.1%} | {wrong.max():.1%} "
            f"| {np.sum(wrong > images.MAX_UNFLAGGED)} |"
        )
    return "\n".join(lines)
