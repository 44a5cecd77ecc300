"""Accuracy and speed of the pair correlation against its peers (make bench-piv).

Flows are rendered with a seed that served no tuning (tuning used seeds below 100). One pair of each
is enough: its 20,000 vectors give an RMS error to 1 %, and the peers cost 12 CPU s per pair. CPU
seconds of one core; RMS errors are per component over the vectors at least 24 px from the edge that
every method gives.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from docs.evidence.piv.flows import CASES, CENTRE, SHAPE, Case
from docs.evidence.piv.pages import machine, write_study
from docs.evidence.piv.pairs import render_pair
from docs.evidence.piv.scores import inner, rms_of, told
from docs.evidence.piv.with_peers import OURS, Pair, compared

SHEET = 12.0  # px
FIRST = 1001


def render(case: Case, seed: int):
    """The pair of a case."""
    flow = case.flow
    moved = (lambda x, y: (*flow(x, y), case.loss * SHEET + 0 * x)) if case.loss else flow
    return render_pair(
        moved, SHAPE, noise=case.noise, sheet_thickness_px=SHEET, background=5.0, seed=seed
    )


def from_centre(x, y):
    """Distance from the middle of the picture, px."""
    return np.hypot(x - CENTRE[0], y - CENTRE[1])


def pairs(seeds: list[int]) -> Iterator[Pair]:
    """Every flow with every seed; the core of a vortex is a row of its own."""
    for k, (label, case) in enumerate(CASES.items()):

        def counts(x, y, hole=case.hole):
            return inner(SHAPE)(x, y) & (from_centre(x, y) >= hole)

        rows = {label: (case.flow, counts)}
        if case.core:
            near = lambda x, y, radius=case.core: from_centre(x, y) < radius  # noqa: E731
            rows[core(label)] = case.flow, near
        for seed in seeds:
            yield Pair(f"{k:02d}_{seed}", render(case, seed), rows)


def core(label: str) -> str:
    """Row of a flow's core."""
    return f"core of {label}"


def study() -> None:
    """Errors of every method, ours against the best peer, uncertainty, speed."""
    seeds = [FIRST]
    results = compared("benchmark", pairs(seeds))
    names = list(results)
    score = {n: {row: rms_of(parts) for row, parts in results[n].items()} for n in names}
    pairs_of = {n: [p for c in CASES for p in results[n][c]] for n in names}
    seconds = {n: float(np.median([p.seconds for p in pairs_of[n]])) for n in names}
    vectors = {n: pairs_of[n][0].vectors for n in names}
    rows = []
    for c, case in CASES.items():
        cells = {n: f"{e:.4f}" if (e := score[n][c]) < 0.01 else f"{e:.3f}" for n in names}
        if case.core:
            cells = {n: f"{cell}/{score[n][core(c)]:.3f}" for n, cell in cells.items()}
        rows.append({"flow": c} | cells)
    rows.append({"flow": "CPU s per pair"} | {n: f"{seconds[n]:.2f}" for n in names})
    rows.append({"flow": "vectors/s"} | {n: f"{vectors[n] / seconds[n]:,.0f}" for n in names})
    openpiv = [n for n in names if n.startswith("OpenPIV")]
    best = {c: min(score[n][c] for n in names[1:]) for c in CASES}
    totals = {n: np.exp(np.mean([np.log(score[n][c]) for c in CASES])) for n in names}
    top = min(openpiv, key=lambda n: totals[n])
    worse = [c for c in CASES if score[OURS][c] > best[c]]
    each = [min(score[n][c] for n in openpiv) / score[OURS][c] for c in CASES]
    peer_time = {
        "OpenPIV at 8 px": min(seconds[n] for n in openpiv if vectors[n] > 15000),
        "PIVtools": min(seconds[n] for n in names if n.startswith("PIVtools")),
    }
    faster = ", ".join(f"{t / seconds[OURS]:.1f}× {n}" for n, t in peer_time.items())
    own = [{"flow": c} | told(results[OURS][c]) for c in CASES]
    write_study(
        "benchmark",
        [pd.DataFrame(rows), pd.DataFrame(own)],
        "RMS error per component, px (after the slash: in the core), where every method gives a"
        " vector",
        f"- Geometric mean of the errors against {top}, the best OpenPIV configuration:"
        f" {totals[top] / totals[OURS]:.2f}×; against the best of each flow over all OpenPIV"
        f" configurations: {np.exp(np.mean(np.log(each))):.2f}×.",
        f"- Worse than the best peer: {', '.join(worse) or 'in no flow'}.",
        f"- Speed (CPU time, same run): {faster}.",
        f"Seed {FIRST}; {machine()}.",
    )
