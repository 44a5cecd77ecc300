"""Planes of three-dimensional turbulence against the peers (make bench-piv).

Seeds 4201 and up, which served no tuning. The peers' configurations are those of the benchmark, in
the same environment. --docs writes the tables into docs/piv_benchmarks; --alone leaves the peers
out and prints only.
"""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
import cv2
import numpy as np
import xarray as xr

from tests.studies.pages import libraries, write_study
from tests.studies.piv.flows import SHAPE
from tests.studies.piv.particles import render
from tests.studies.piv.scores import TOLD, inner, rms_of, speed, told
from tests.studies.piv.turbulence_field import TurbulentPlane
from tests.studies.piv.with_peers import OURS, Pair, add, arguments, with_peers

FIRST = 4201
CASES = {
    f"{rms} px, {noise:.0%}": (rms, noise) for rms in (0.3, 0.8, 2.5) for noise in (0.05, 0.01)
}
PLAIN = "`--no-smoothing`"


def derivatives(u, v, step):
    """Divergence and vorticity by central differences, at the inner vectors."""
    (uy, ux), (vy, vx) = (
        ((f[2:, 1:-1] - f[:-2, 1:-1]) / (2 * step), (f[1:-1, 2:] - f[1:-1, :-2]) / (2 * step))
        for f in (u, v)
    )
    return ux + vy, vx - uy


def gains(ds: xr.Dataset, flow: Callable) -> list[float]:
    """Of divergence and vorticity: slopes of inner vectors' differences against exact ones."""
    x, y = ds["x"].values, ds["y"].values
    gx, gy = np.meshgrid(x, y)
    counts = inner(SHAPE)(gx, gy)[1:-1, 1:-1]
    slopes = []
    seen = derivatives(ds["u"].values, ds["v"].values, x[1] - x[0])
    for found, exact in zip(seen, derivatives(*flow(gx, gy), x[1] - x[0]), strict=True):
        ok = np.isfinite(found) & counts
        slopes.append(np.sum(found[ok] * exact[ok]) / np.sum(exact[ok] ** 2))
    return slopes


def pairs(seeds: list[int]) -> Iterator[Pair]:
    """Every strength and noise with every plane."""
    planes = {seed: TurbulentPlane(1.0, seed) for seed in seeds}
    for case, (rms, noise) in CASES.items():
        for seed, plane in planes.items():

            def moved(x, y, rms=rms, plane=plane):
                return tuple(rms * d for d in plane(x, y, 3))

            def flow(x, y, rms=rms, plane=plane):
                return tuple(rms * d for d in plane(x, y))

            images = render(moved, shape=SHAPE, seed=seed, noise=noise)
            runs = {OURS: {}, PLAIN: {"smoothing": False}}
            yield Pair(f"{rms}_{noise}_{seed}", tuple(images), {case: (flow, inner(SHAPE))}, runs)


def run(seeds: list[int], keep: Path | None = None, alone: bool = False) -> tuple[dict, dict]:
    """Errors by method and case, and gains of our own runs likewise."""
    results: dict = {}
    slopes: dict = {}
    for pair, found in with_peers(keep, pairs(seeds), alone):
        add(results, pair, found)
        for case, (flow, _) in pair.rows.items():
            for name in pair.runs:
                slopes.setdefault(name, {}).setdefault(case, []).append(gains(found[name], flow))
    return results, slopes


def tables(results: dict, slopes: dict, seeds: list[int]) -> str:
    """Markdown: errors beside the best peers, and what is told of our own vectors."""
    peers = [p for p in ("OpenPIV", "PIVtools") if any(m.startswith(p) for m in results)]
    head = [OURS, PLAIN, *(f"best {p}" for p in peers), *(f"against {p}" for p in peers)]
    lines = [
        f"| u', noise | {' | '.join(head)} | gain of divergence, vorticity (without smoothing) |",
        "|---" * (len(head) + 2) + "|",
    ]
    own = [f"| u', noise | {TOLD} vectors/s |", "|---" * 6 + "|"]
    for case in CASES:
        root = {m: rms_of(results[m][case]) for m in results}
        best = [min((root[m], m) for m in results if m.startswith(peer)) for peer in peers]
        gain = ["{:.2f}, {:.2f}".format(*np.mean(slopes[m][case], axis=0)) for m in (OURS, PLAIN)]
        cells = [
            f"{root[OURS]:.4f} px",
            f"{root[PLAIN]:.4f}",
            *(f"{e:.4f} ({m.split(' ', 1)[1]})" for e, m in best),
        ]
        cells += [*(f"{e / root[OURS]:.2f}×" for e, _ in best), f"{gain[0]} ({gain[1]})"]
        lines.append(f"| {case} | {' | '.join(cells)} |")
        own.append(f"| {case} | {told(results[OURS][case])} {speed(results[OURS][case]):,.0f} |")
    return "\n".join([*lines, "", *own, "", f"Seeds {seeds[0]}-{seeds[-1]}; {libraries()}."])


def main() -> None:
    """Run, print, and write to the docs where asked."""
    args = arguments(__doc__, seeds=2, alone=True)
    cv2.setNumThreads(1)
    seeds = list(range(FIRST, FIRST + args.seeds))
    text = tables(*run(seeds, args.folder, args.alone), seeds)
    print(text)
    if args.docs:
        write_study("turbulence", text)


if __name__ == "__main__":
    main()
