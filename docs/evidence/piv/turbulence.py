"""Planes of three-dimensional turbulence against the peers (make bench-piv).

Seed 4201, which served no tuning.
"""

from collections.abc import Callable, Iterator

import numpy as np
import pandas as pd
import xarray as xr

from docs.evidence.piv.flows import SHAPE, TurbulentPlane
from docs.evidence.piv.pages import libraries, write_study
from docs.evidence.piv.particles import render
from docs.evidence.piv.scores import inner, rms_of, speed, told
from docs.evidence.piv.with_peers import OURS, PEER_NAMES, Pair, add, with_peers

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
    u, v = flow(gx, gy)
    for found, exact in zip(seen, derivatives(u, v, x[1] - x[0]), strict=True):
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

            a, b = render(moved, shape=SHAPE, seed=seed, noise=noise)
            runs = {OURS: {}, PLAIN: {"smoothing": False}}
            yield Pair(f"{rms}_{noise}_{seed}", (a, b), {case: (flow, inner(SHAPE))}, runs)


def study() -> None:
    """Errors beside the best peers, and what is told of our own vectors."""
    seeds = [FIRST]
    results: dict = {}
    slopes: dict = {}
    for pair, found in with_peers("turbulence", pairs(seeds)):
        add(results, pair, found)
        for case, (flow, _) in pair.rows.items():
            for name in pair.runs:
                slopes.setdefault(name, {}).setdefault(case, []).append(gains(found[name], flow))
    rows, own = [], []
    for case in CASES:
        root = {m: rms_of(results[m][case]) for m in results}
        gain = ["{:.2f}, {:.2f}".format(*np.mean(slopes[m][case], axis=0)) for m in (OURS, PLAIN)]
        cells = {"u', noise": case, OURS: f"{root[OURS]:.4f} px", PLAIN: f"{root[PLAIN]:.4f}"}
        best = {p: min((root[m], m) for m in results if m.startswith(p)) for p in PEER_NAMES}
        cells |= {f"best {p}": f"{e:.4f} ({m.split(' ', 1)[1]})" for p, (e, m) in best.items()}
        cells |= {f"against {p}": f"{e / root[OURS]:.2f}×" for p, (e, _) in best.items()}
        told_gain = {"gain of divergence, vorticity (without smoothing)": f"{gain[0]} ({gain[1]})"}
        rows.append(cells | told_gain)
        speed_of = {"vectors/s": f"{speed(results[OURS][case]):,.0f}"}
        own.append({"u', noise": case} | told(results[OURS][case]) | speed_of)
    tables = [pd.DataFrame(rows), pd.DataFrame(own)]
    write_study("turbulence", tables, f"Seed {FIRST}; {libraries()}.")
