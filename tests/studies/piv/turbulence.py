"""Planes of three-dimensional turbulence against the peers: python -m tests.studies.piv.turbulence [--seeds N] [--docs].

Seeds 4201 and up, which served no tuning. The peers' configurations are those of the benchmark, in the same environment.
--docs writes the tables into docs/piv_benchmarks.md.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
import cv2
import numpy as np

from piv.correlation.pair import correlate_pair
from tests.studies.pages import PIV, libraries, write_between
from tests.studies.piv.benchmark import EDGE, pairs_folder, peer_python
from tests.studies.piv.flows import SHAPE
from tests.studies.piv.particles import render
from tests.studies.piv.turbulence_field import TurbulentPlane

FIRST = 4201
CASES = tuple((rms, noise) for rms in (0.3, 0.8, 2.5) for noise in (0.05, 0.01))
FAR = 0.5  # px


def derivatives(u, v, step):
    """Divergence and vorticity by central differences, at the inner vectors."""
    (uy, ux), (vy, vx) = (
        ((f[2:, 1:-1] - f[:-2, 1:-1]) / (2 * step), (f[1:-1, 2:] - f[1:-1, :-2]) / (2 * step)) for f in (u, v)
    )
    return ux + vy, vx - uy


def score(plane: TurbulentPlane, rms: float, x, y, u, v) -> dict:
    """RMS error, gains of divergence and vorticity (slopes against the exact field's differences), errors where they count."""
    gx, gy = np.meshgrid(x, y)
    true = [rms * f for f in plane(gx, gy)]
    inside = (gx >= EDGE) & (gx <= SHAPE[1] - 1 - EDGE) & (gy >= EDGE) & (gy <= SHAPE[0] - 1 - EDGE)
    e = np.stack([u - true[0], v - true[1]])[:, inside]
    step = x[1] - x[0]
    gains = []
    for seen, exact in zip(derivatives(u, v, step), derivatives(*true, step), strict=True):
        ok = np.isfinite(seen) & inside[1:-1, 1:-1]
        gains.append(np.sum(seen[ok] * exact[ok]) / np.sum(exact[ok] ** 2))
    return {
        "square": np.nanmean(e**2),
        "divergence": gains[0],
        "vorticity": gains[1],
        "e": e,
        "inside": inside,
    }


def run(seeds: list[int], keep: Path | None = None) -> dict:
    """Scores per method and case."""
    scores: dict = {}
    planes = {seed: TurbulentPlane(1.0, seed) for seed in seeds}
    with pairs_folder(keep) as folder:
        jobs = [
            (rms, noise, seed, folder / f"{rms}_{noise}_{seed}.pair.npz")
            for rms, noise in CASES
            for seed in seeds
        ]
        for rms, noise, seed, file in jobs:

            def moved(x, y, rms=rms, plane=planes[seed]):
                return tuple(rms * d for d in plane(x, y, 3))

            a, b = render(moved, shape=SHAPE, seed=seed, noise=noise)
            np.savez(file, a=a, b=b)
            if not scores:
                correlate_pair(a, b)
            for label, options in (("this project", {}), ("`--no-smoothing`", {"smoothing": False})):
                start = time.process_time()
                ds = correlate_pair(a, b, **options)
                seconds = time.process_time() - start
                s = score(planes[seed], rms, *(ds[n].values for n in "xyuv")) | {"seconds": seconds}
                std = np.stack([ds["u_std"].values, ds["v_std"].values])[:, s["inside"]]
                flag, e = ds["flag"].values[s["inside"]], s["e"]
                given = np.isfinite(e).all(axis=0)
                plain = given & (flag != 5)
                s |= {"absent": 1 - given.mean(), "uncertain": np.mean(given & (flag == 5)), "cover": np.mean((np.abs(e) < std)[:, given]),
                      "far": np.mean(np.hypot(*e)[plain] > FAR), "vectors": ds["u"].size}  # fmt: skip
                scores.setdefault(label, {}).setdefault((rms, noise), []).append(s)
        subprocess.run([peer_python(), Path(__file__).with_name("peers.py"), folder],
                       cwd=folder, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip
        for rms, noise, seed, file in jobs:
            r = np.load(file.with_name(file.name.replace(".pair.", ".peers.")))
            for k in range(sum(n.endswith("_name") for n in r.files)):
                s = score(planes[seed], rms, *(r[f"{k}_{n}"] for n in "xyuv"))
                scores.setdefault(str(r[f"{k}_name"]), {}).setdefault((rms, noise), []).append(s)
    return scores


def tables(scores: dict, seeds: list[int]) -> str:
    """Markdown: errors beside the best peers, and what is told of our own vectors."""

    def mean(method, case, key):
        return float(np.mean([s[key] for s in scores[method][case]]))

    lines = [
        "| u', noise | this project | `--no-smoothing` | best OpenPIV | best PIVtools | against OpenPIV | against PIVtools | gain of divergence, vorticity (without smoothing) |",
        "|---|---|---|---|---|---|---|---|",
    ]
    own = ["| u', noise | coverage of ±1 standard uncertainty | uncertain (flag 5) | of the others > 0.5 px | absent | vectors/s |", "|---|---|---|---|---|---|"]  # fmt: skip
    for case in CASES:
        root = {m: mean(m, case, "square") ** 0.5 for m in scores}
        best = [min((root[m], m) for m in scores if m.startswith(peer)) for peer in ("OpenPIV", "PIVtools")]
        ours, plain = (root[m] for m in ("this project", "`--no-smoothing`"))
        gains = [f"{mean(m, case, 'divergence'):.2f}, {mean(m, case, 'vorticity'):.2f}" for m in ("this project", "`--no-smoothing`")]  # fmt: skip
        label = f"{case[0]} px, {case[1]:.0%}"
        lines.append(f"| {label} | {ours:.4f} px | {plain:.4f} | " + " | ".join(f"{e:.4f} ({m.split()[1]})" for e, m in best)
                     + f" | {best[0][0] / ours:.2f}× | {best[1][0] / ours:.2f}× | {gains[0]} ({gains[1]}) |")  # fmt: skip
        cover, uncertain, far, absent, seconds, vectors = (
            mean("this project", case, n)
            for n in ("cover", "uncertain", "far", "absent", "seconds", "vectors")
        )
        own.append(f"| {label} | {cover:.0%} | {uncertain:.2%} | {far:.2%} | {absent:.2%} | {vectors / seconds:,.0f} |")  # fmt: skip
    return "\n".join([*lines, "", *own, "", f"Seeds {seeds[0]}-{seeds[-1]}; {libraries()}."])


def main() -> None:
    """Run, print, and write to the docs where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=2, help="planes per case")
    parser.add_argument(
        "--folder", type=Path, help="keep pairs and peers' results there; a stopped run goes on"
    )
    parser.add_argument("--docs", action="store_true", help="write the tables into docs/piv_benchmarks.md")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    seeds = list(range(FIRST, FIRST + args.seeds))
    text = tables(run(seeds, args.folder), seeds)
    print(text)
    if args.docs:
        write_between(PIV, "turbulence", text)


if __name__ == "__main__":
    main()
