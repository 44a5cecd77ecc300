"""Accuracy and speed of the pair correlation against its peers (make bench-piv).

Flows are rendered with seeds that served no tuning (tuning used seeds below 100). CPU seconds of
one core; RMS errors are per component over the vectors at least 24 px from the edge that every
method gives. --docs writes the tables into docs/piv_benchmarks.
"""

import os
from collections.abc import Iterator

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import cv2
import numpy as np

from tests.studies.pages import machine, write_study
from tests.studies.piv.flows import CASES, CENTRE, SHAPE, Case
from tests.studies.piv.pairs import render_pair
from tests.studies.piv.scores import TOLD, inner, rms_of, told
from tests.studies.piv.with_peers import OURS, Pair, arguments, compared

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
            rows[core(label)] = (
                case.flow,
                lambda x, y, radius=case.core: from_centre(x, y) < radius,
            )
        for seed in seeds:
            yield Pair(f"{k:02d}_{seed}", render(case, seed), rows)


def core(label: str) -> str:
    """Row of a flow's core."""
    return f"core of {label}"


def tables(results: dict, seeds: list[int]) -> str:
    """Markdown: errors of every method, ours against the best peer, uncertainty, speed."""
    names = list(results)
    score = {n: {row: rms_of(parts) for row, parts in results[n].items()} for n in names}
    pairs_of = {n: [p for c in CASES for p in results[n][c]] for n in names}
    seconds = {n: float(np.median([p.seconds for p in pairs_of[n]])) for n in names}
    vectors = {n: pairs_of[n][0].vectors for n in names}
    lines = [
        "RMS error per component, px (after the slash: in the core), where every method gives a "
        "vector",
        "",
        "| flow | " + " | ".join(names) + " |",
        "|---" * (len(names) + 1) + "|",
    ]
    for c, case in CASES.items():
        cells = [f"{e:.4f}" if (e := score[n][c]) < 0.01 else f"{e:.3f}" for n in names]
        if case.core:
            cells = [
                f"{cell}/{score[n][core(c)]:.3f}" for cell, n in zip(cells, names, strict=True)
            ]
        lines.append(f"| {c} | " + " | ".join(cells) + " |")
    lines.append("| CPU s per pair | " + " | ".join(f"{seconds[n]:.2f}" for n in names) + " |")
    lines.append(
        "| vectors/s | " + " | ".join(f"{vectors[n] / seconds[n]:,.0f}" for n in names) + " |"
    )
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
    lines += [
        "",
        f"- Geometric mean of the errors against {top}, the best OpenPIV configuration: "
        f"{totals[top] / totals[OURS]:.2f}×; against the best of each flow over all OpenPIV "
        f"configurations: {np.exp(np.mean(np.log(each))):.2f}×.",
        f"- Worse than the best peer: {', '.join(worse) or 'in no flow'}.",
        "- Speed (CPU time, same run): "
        + ", ".join(f"{t / seconds[OURS]:.1f}× {n}" for n, t in peer_time.items())
        + ".",
    ]
    lines += ["", f"| flow | {TOLD}", "|---" * 5 + "|"]
    lines += [f"| {c} | {told(results[OURS][c])}" for c in CASES]
    return "\n".join([*lines, "", f"Seeds {seeds[0]}-{seeds[-1]}; {machine()}."])


def main() -> None:
    """Run, print, and write to the docs where asked."""
    args = arguments(__doc__, seeds=2)
    cv2.setNumThreads(1)
    seeds = list(range(FIRST, FIRST + args.seeds))
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    text = tables(compared(args.folder, pairs(seeds)), seeds)
    print(text)
    if args.docs:
        write_study("benchmark", text)


if __name__ == "__main__":
    main()
