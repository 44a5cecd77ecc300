"""The same pairs of images by the project and by its peers, in their environment.

OpenPIV 0.26 (windef, four configurations), PIVtools 0.7 and fluidimage 0.5 (two each) are installed
in `.venv-bench` at the first run, or where BENCH_VENV says.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from docs.evidence.piv.scores import Errors, judged
from piv.correlation.pair import correlate_pair

BENCH = Path(os.environ.get("BENCH_VENV", Path(__file__).resolve().parents[3] / ".venv-bench"))
PEER_NAMES = ("OpenPIV", "PIVtools", "fluidimage")
OURS = "this project"
PEERS = [
    "openpiv==0.26.0", "fluidimage==0.5.5",
    "dask[distributed]", "dask-image", "loguru", "lz4", "pandas", "pillow",
    "PyYAML", "tifffile", "tqdm", "psutil", "scikit-image", "bottleneck", "scikit-learn",
    "threadpoolctl", "matplotlib", "cinereader", "rawpy", "numba", "opencv-python-headless",
]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Pair:
    """Two images of one size, and what their vectors are judged by.

    `rows`: by the name of a table's row the exact displacement flow(x, y) (px, y up from the bottom
    row) and counts(x, y) -> bool.
    """

    name: str
    images: tuple[np.ndarray, np.ndarray]
    rows: dict[str, tuple[Callable, Callable]]
    # options of our own runs
    runs: dict[str, dict[str, Any]] = field(default_factory=lambda: {OURS: {}})
    mask: np.ndarray | None = None  # bool, true = body, for the peers that take masks


def peer_python() -> Path:
    """Interpreter of the peers' environment, made when it is missing."""
    python = BENCH / "bin" / "python"
    if not (BENCH / ".ready").exists():
        subprocess.run([sys.executable, "-m", "venv", BENCH], check=True)
        pip = [str(python), "-m", "pip", "install", "-q"]
        subprocess.run([*pip, *PEERS], check=True)
        # it asks for Python 3.12 but uses nothing of it here
        alone = ["--no-deps", "--ignore-requires-python", "pivtools==0.7.0"]
        subprocess.run([*pip, *alone], check=True)
        (BENCH / ".ready").touch()
    return python


def with_peers(name: str, pairs: Iterable[Pair]) -> Iterator[tuple[Pair, dict[str, xr.Dataset]]]:
    """Each pair with the vectors (px; attribute `cpu_s`) of our runs and of every peer.

    `name`: of the folder below BENCH that keeps pairs and peers' results. What the peers say of
    errors goes to this command's own stderr.
    """
    folder, jobs = BENCH / name, list[tuple[Pair, dict[str, xr.Dataset]]]()
    folder.mkdir(parents=True, exist_ok=True)
    for pair in pairs:
        a, b = pair.images
        arrays: dict[str, Any] = {"a": a, "b": b}
        arrays |= {} if pair.mask is None else {"mask": pair.mask}
        np.savez(folder / f"{pair.name}.pair.npz", **arrays)
        if not jobs:
            correlate_pair(a, b)  # compiles
        jobs.append((pair, {run: timed(a, b, **options) for run, options in pair.runs.items()}))
    command = [peer_python(), Path(__file__).with_name("peers.py"), folder]
    subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    for pair, found in jobs:
        yield pair, found | peers_vectors(folder / f"{pair.name}.peers.npz")


def compared(name: str, pairs: Iterable[Pair]) -> dict[str, dict[str, list[Errors]]]:
    """Errors of each pair by method and row; our own runs come first."""
    results: dict = {}
    for pair, found in with_peers(name, pairs):
        add(results, pair, found)
    return results


def add(
    results: dict[str, dict[str, list[Errors]]], pair: Pair, found: dict[str, xr.Dataset]
) -> None:
    """Append a pair's errors of every method."""
    for name, ds in found.items():
        for row, (flow, counts) in pair.rows.items():
            errors = judged(ds, flow, counts, found.values())
            results.setdefault(name, {}).setdefault(row, []).append(errors)


def timed(a: np.ndarray, b: np.ndarray, **options) -> xr.Dataset:
    """Our own vectors, with the CPU time that they took."""
    start = time.process_time()
    ds = correlate_pair(a, b, **options)
    return ds.assign_attrs(cpu_s=time.process_time() - start)


def peers_vectors(file: Path) -> dict[str, xr.Dataset]:
    """What peers.py wrote of a pair, by configuration."""
    found = {}
    with np.load(file) as r:
        for k in range(sum(n.endswith("_name") for n in r.files)):
            x, y, u, v = (r[f"{k}_{n}"] for n in "xyuv")
            fields, spent = {"u": (("y", "x"), u), "v": (("y", "x"), v)}, float(r[f"{k}_t"])
            found[str(r[f"{k}_name"])] = xr.Dataset(fields, {"x": x, "y": y}, {"cpu_s": spent})
    return found
