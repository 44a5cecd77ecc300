"""Flows that served no tuning, with their own seeds (python -m tests.studies.piv.unseen).

Own results only; --docs writes the table into docs/piv_benchmarks.
"""

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
import cv2
import numpy as np

from piv.correlation.pair import correlate_pair
from tests.studies.pages import libraries, write_study
from tests.studies.piv.flows import CENTRE, SHAPE, lamb_oseen
from tests.studies.piv.pairs import render_pair
from tests.studies.piv.scores import EDGE, HEAD, Errors, inner, judged, row

SEEDS = (2001, 2002, 2003)
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


def results(flow, masked: bool, seed: int) -> Errors:
    """Of the inner vectors of a pair; of those beside the body also the ones next to it."""
    a, b = render_pair(flow, SHAPE, noise=0.05, background=5.0, seed=seed)
    if not masked:
        return judged(correlate_pair(a, b), flow, inner(SHAPE))
    rows = np.arange(SHAPE[0])[:, None] > SHAPE[0] - 1 - WALL
    mask = np.broadcast_to(rows, SHAPE)
    a, b = (np.where(mask, 5, i).astype(i.dtype) for i in (a, b))
    return judged(
        correlate_pair(a, b, mask=mask),
        flow,
        lambda x, y: inner(SHAPE)(x, np.maximum(y, EDGE)) & (y > WALL),
    )


def table() -> str:
    """All flows as Markdown."""
    lines = [f"| flow (5 % noise) | {HEAD}"]
    for label, (flow, masked) in FLOWS.items():
        lines.append(f"| {label} | {row([results(flow, masked, seed) for seed in SEEDS])}")
    return "\n".join([*lines, "", f"Seeds {SEEDS[0]}-{SEEDS[-1]}; {libraries()}."])


def main() -> None:
    """Print the table, and write it to the docs where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--docs", action="store_true", help="write the table into docs/piv_benchmarks"
    )
    args = parser.parse_args()
    cv2.setNumThreads(1)
    text = table()
    print(text)
    if args.docs:
        write_study("unseen", text)


if __name__ == "__main__":
    main()
