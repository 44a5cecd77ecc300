"""Accuracy and speed of piv.correlation.pair against its peers: python -m tests.studies.piv.benchmark [--seeds N] [--docs].

Peers (OpenPIV 0.26 windef in four configurations, PIVtools 0.7) are installed in `.venv-bench` at the first run. Flows
are rendered with seeds that served no tuning (tuning used seeds below 100). CPU seconds of one core; RMS errors are per
component over the vectors at least 24 px from the edge. --docs writes the tables into docs/piv_benchmarks.md.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ROOT = Path(__file__).resolve().parents[3]
import cv2
import numpy as np

from piv.correlation.pair import correlate_pair
from piv.synthetic.render_recording import render_pair
from tests.studies.pages import PIV, machine, write_between
from tests.studies.piv.figures import extra_figures
from tests.studies.piv.flows import CASES, CENTRE, SHAPE

SHEET = 12.0  # px
EDGE = 24
PEERS = ["openpiv==0.26.0", "dask[distributed]", "dask-image", "loguru", "lz4", "pandas", "pillow", "PyYAML", "tifffile",
         "tqdm", "psutil", "scikit-image", "bottleneck", "scikit-learn", "threadpoolctl", "matplotlib", "cinereader",
         "rawpy", "numba", "opencv-python-headless"]  # fmt: skip


def peer_python() -> Path:
    """Interpreter of the peers' environment, made when it is missing."""
    folder = Path(os.environ.get("BENCH_VENV", ROOT / ".venv-bench"))
    python = folder / "bin" / "python"
    if not (folder / ".ready").exists():
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        pip = [python, "-m", "pip", "install", "-q"]
        subprocess.run([*pip, *PEERS], check=True)
        # it asks for Python 3.12 but uses nothing of it here
        subprocess.run([*pip, "--no-deps", "--ignore-requires-python", "pivtools==0.7.0"], check=True)
        (folder / ".ready").touch()
    return python


def render(case, seed: int):
    """The pair of a case."""
    flow = case.flow
    moved = (lambda x, y: (*flow(x, y), case.loss * SHEET + 0 * x)) if case.loss else flow
    return render_pair(moved, SHAPE, noise=case.noise, sheet_thickness_px=SHEET, background=5.0, seed=seed)


def errors(case, x, y, u, v):
    """Errors (2, n) of the vectors that count and of those in the core, and the selection."""
    gx, gy = np.meshgrid(x, y)
    tu, tv = case.flow(gx, gy)
    r = np.hypot(gx - CENTRE[0], gy - CENTRE[1])
    inside = (
        (gx >= EDGE)
        & (gx <= SHAPE[1] - 1 - EDGE)
        & (gy >= EDGE)
        & (gy <= SHAPE[0] - 1 - EDGE)
        & (r >= case.hole)
    )
    e = np.stack([u - tu, v - tv])
    return e[:, inside], e[:, inside & (r < case.core)], inside


def rms(e: np.ndarray) -> float:
    """Root mean square of what is finite."""
    e = e[np.isfinite(e)]
    return float(np.sqrt(np.mean(e**2))) if e.size else float("nan")


@contextmanager
def pairs_folder(asked: Path | None) -> Iterator[Path]:
    """The folder of the pairs and of the peers' results: the one asked for, or a temporary one."""
    if asked is None:
        with tempfile.TemporaryDirectory() as name:
            yield Path(name)
    else:
        asked.mkdir(parents=True, exist_ok=True)
        yield asked.resolve()


def run(seeds: list[int], keep: Path | None = None) -> dict:
    """Results per method and case: RMS, RMS in the core, seconds, vectors; of ours also coverage and outliers."""
    results: dict = {}
    with pairs_folder(keep) as folder:
        jobs = {}
        for k, (label, case) in enumerate(CASES.items()):
            for seed in seeds:
                file = folder / f"{k:02d}_{seed}.pair.npz"
                a, b = render(case, seed)
                np.savez(file, a=a, b=b)
                jobs[file] = label
        warm = np.load(next(iter(jobs)))
        correlate_pair(warm["a"], warm["b"])
        for file, label in jobs.items():
            pair = np.load(file)
            start = time.process_time()
            ds = correlate_pair(pair["a"], pair["b"])
            seconds = time.process_time() - start
            e, core, inside = errors(
                CASES[label], ds["x"].values, ds["y"].values, ds["u"].values, ds["v"].values
            )
            std = np.stack([ds["u_std"].values[inside], ds["v_std"].values[inside]])
            ok = np.isfinite(e)
            far = np.hypot(*e) > 0.5
            row = (
                e,
                core,
                seconds,
                ds["u"].size,
                np.mean(np.abs(e[ok]) < std[ok]),
                far[ok.all(axis=0)].mean(),
                1 - ok.mean(),
            )
            results.setdefault("this project", {}).setdefault(label, []).append(row)
        subprocess.run([peer_python(), Path(__file__).with_name("peers.py"), folder],
            cwd=folder, check=True, stdout=subprocess.DEVNULL,
                       stderr=subprocess.DEVNULL)  # fmt: skip
        for file, label in jobs.items():
            r = np.load(file.with_name(file.name.replace(".pair.", ".peers.")))
            for k in range(sum(n.endswith("_name") for n in r.files)):
                x, y, u, v = (r[f"{k}_{n}"] for n in "xyuv")
                e, core, _ = errors(CASES[label], x, y, u, v)
                row = (e, core, float(r[f"{k}_t"]), u.size)
                results.setdefault(str(r[f"{k}_name"]), {}).setdefault(label, []).append(row)
    return results


def tables(results: dict, seeds: list[int]) -> str:
    """Markdown: errors of every method, ours against the best peer, uncertainty, speed."""
    names = list(results)
    score = {
        n: {c: rms(np.concatenate([r[0] for r in rows], axis=1)) for c, rows in results[n].items()}
        for n in names
    }
    core = {
        n: {c: rms(np.concatenate([r[1] for r in rows], axis=1)) for c, rows in results[n].items()}
        for n in names
    }
    seconds = {n: np.median([r[2] for rows in results[n].values() for r in rows]) for n in names}
    vectors = {n: next(iter(results[n].values()))[0][3] for n in names}
    lines = [
        "RMS error per component, px (after the slash: in the core)",
        "",
        "| flow | " + " | ".join(names) + " |",
    ]
    lines.append("|---" * (len(names) + 1) + "|")
    for c in CASES:
        cells = []
        for n in names:
            text = f"{score[n][c]:.4f}" if score[n][c] < 0.01 else f"{score[n][c]:.3f}"
            cells.append(text + (f"/{core[n][c]:.3f}" if CASES[c].core else ""))
        lines.append(f"| {c} | " + " | ".join(cells) + " |")
    lines.append("| CPU s per pair | " + " | ".join(f"{seconds[n]:.2f}" for n in names) + " |")
    lines.append("| vectors/s | " + " | ".join(f"{vectors[n] / seconds[n]:,.0f}" for n in names) + " |")
    ours, openpiv = names[0], [n for n in names if n.startswith("OpenPIV")]
    best = {c: min(score[n][c] for n in names[1:]) for c in CASES}
    totals = {n: np.exp(np.mean([np.log(score[n][c]) for c in CASES])) for n in names}
    top = min(openpiv, key=lambda n: totals[n])
    worse = [c for c in CASES if score[ours][c] > best[c]]
    peer_time = {"OpenPIV at 8 px": min(seconds[n] for n in openpiv if vectors[n] > 15000),
                 "PIVtools": min(seconds[n] for n in names if n.startswith("PIVtools"))}  # fmt: skip
    lines += ["", f"- Geometric mean of the errors against {top}, the best OpenPIV configuration: {totals[top] / totals[ours]:.2f}×; "
              f"against the best of each flow over all OpenPIV configurations: "
              f"{np.exp(np.mean([np.log(min(score[n][c] for n in openpiv) / score[ours][c]) for c in CASES])):.2f}×.",
              f"- Worse than the best peer: {', '.join(worse) or 'in no flow'}.",
              "- Speed (CPU time, same run): " + ", ".join(f"{t / seconds[ours]:.1f}× {n}" for n, t in peer_time.items()) + "."]  # fmt: skip
    lines += [
        "",
        "| flow | coverage of ±1 standard uncertainty | unflagged > 0.5 px | absent |",
        "|---|---|---|---|",
    ]
    for c, rows in results[ours].items():
        cover, far, gone = (np.mean([r[k] for r in rows]) for k in (4, 5, 6))
        lines.append(f"| {c} | {cover:.0%} | {far:.3%} | {gone:.2%} |")
    lines.append("")
    lines.append(f"Seeds {seeds[0]}-{seeds[-1]}; {machine()}.")
    return "\n".join(lines)


def main() -> None:
    """Run, print, and write to the docs where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=2, help="pairs per flow")
    parser.add_argument(
        "--folder", type=Path, help="keep pairs and peers' results there; a stopped run goes on"
    )
    parser.add_argument("--docs", action="store_true", help="write the tables into docs/piv_benchmarks.md")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    seeds = list(range(1001, 1001 + args.seeds))
    everywhere = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(everywhere)})
    text = tables(run(seeds, args.folder), seeds)
    print(text, flush=True)
    os.sched_setaffinity(0, everywhere)
    more = extra_figures()
    print(more)
    if args.docs:
        write_between(PIV, "benchmark", f"{text}\n\n{more}")


if __name__ == "__main__":
    main()
