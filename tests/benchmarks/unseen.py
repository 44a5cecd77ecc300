"""Flows that served no tuning, with seeds of their own: python tests/benchmarks/unseen.py (Markdown, own results only)."""

from __future__ import annotations

import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path[:0] = [str(Path(__file__).resolve().parents[2]), str(Path(__file__).parent)]
import cv2  # noqa: E402
import numpy as np  # noqa: E402
from flows import CENTRE, SHAPE, lamb_oseen  # noqa: E402

from piv.correlate import correlate_pair  # noqa: E402
from piv.synthetic import render_pair  # noqa: E402

SEEDS = (2001, 2002, 2003)
EDGE = 24
WALL = 200.0  # px above the bottom row: the body beside which the boundary layer flows


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


FLOWS = {
    "stagnation point": (stagnation, False),
    "Taylor-Green, 180 px": (taylor_green, False),
    "merging vortices": (merging, False),
    "boundary layer beside a mask": (boundary_layer, True),
}


def results(flow, masked: bool, seed: int):
    """Errors, their standard uncertainties (2, n; NaN where absent)."""
    a, b = render_pair(flow, SHAPE, noise=0.05, background=5.0, seed=seed)
    mask = None
    if masked:
        rows = np.arange(SHAPE[0])[:, None] > SHAPE[0] - 1 - WALL
        mask = np.broadcast_to(rows, SHAPE)
        a, b = (np.where(mask, 5, i).astype(i.dtype) for i in (a, b))
    ds = correlate_pair(a, b, mask=mask)
    x, y = np.meshgrid(ds["x"], ds["y"])
    u, v = flow(x, y)
    inside = (x >= EDGE) & (x <= SHAPE[1] - 1 - EDGE) & (y <= SHAPE[0] - 1 - EDGE)
    inside &= y > WALL if masked else y >= EDGE
    e = np.stack([ds["u"].values - u, ds["v"].values - v])
    return e[:, inside], np.stack([ds["u_std"].values, ds["v_std"].values])[:, inside]


def main() -> None:
    """Print the table."""
    cv2.setNumThreads(1)
    print(
        "| flow (5 % noise) | RMS error, px | coverage of ±1 standard uncertainty | unflagged > 0.5 px | absent |"
    )
    print("|---|---|---|---|---|")
    for label, (flow, masked) in FLOWS.items():
        parts = [results(flow, masked, seed) for seed in SEEDS]
        e, std = (np.concatenate([p[k] for p in parts], axis=1) for k in (0, 1))
        known = np.isfinite(e).all(axis=0)
        cover = np.mean(np.abs(e[:, known]) < std[:, known])
        far = np.mean(np.hypot(*e[:, known]) > 0.5)
        rms = np.sqrt(np.mean(e[:, known] ** 2))
        print(f"| {label} | {rms:.4f} | {cover:.0%} | {far:.3%} | {np.mean(~known):.2%} |")


if __name__ == "__main__":
    main()
