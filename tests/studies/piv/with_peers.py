"""The same pairs of images by the project and by its peers, in their environment.

OpenPIV 0.26 (windef, four configurations) and PIVtools 0.7 are installed in `.venv-bench` at the
first run, or where BENCH_VENV says.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from piv.correlation.pair import correlate_pair
from tests.studies.piv.scores import Errors, judged

ROOT = Path(__file__).resolve().parents[3]
OURS = "this project"
PEERS = [
    "openpiv==0.26.0", "dask[distributed]", "dask-image", "loguru", "lz4", "pandas", "pillow",
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


def arguments(
    text: str | None, seeds: int | None = None, alone: bool = False
) -> argparse.Namespace:
    """Switches of a comparison: --folder, --docs, with `seeds` --seeds, with `alone` --alone."""
    parser = argparse.ArgumentParser(description=text)
    if seeds is not None:
        parser.add_argument("--seeds", type=int, default=seeds, help="pairs per row")
    kept = "keep pairs and peers' results there; a stopped run goes on"
    parser.add_argument("--folder", type=Path, help=kept)
    end = parser.add_mutually_exclusive_group()
    end.add_argument("--docs", action="store_true", help="write them into docs/piv_benchmarks")
    if alone:
        end.add_argument("--alone", action="store_true", help="without the peers, only printed")
    return parser.parse_args()


def peer_python() -> Path:
    """Interpreter of the peers' environment, made when it is missing."""
    folder = Path(os.environ.get("BENCH_VENV", ROOT / ".venv-bench"))
    python = folder / "bin" / "python"
    if not (folder / ".ready").exists():
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        pip = [python, "-m", "pip", "install", "-q"]
        subprocess.run([*pip, *PEERS], check=True)
        # it asks for Python 3.12 but uses nothing of it here
        alone = ["--no-deps", "--ignore-requires-python", "pivtools==0.7.0"]
        subprocess.run([*pip, *alone], check=True)
        (folder / ".ready").touch()
    return python


@contextmanager
def kept_or_temporary(asked: Path | None) -> Iterator[Path]:
    """The folder that was asked for, made where it is missing, or a temporary one."""
    if asked is None:
        with tempfile.TemporaryDirectory() as name:
            yield Path(name)
    else:
        asked.mkdir(parents=True, exist_ok=True)
        yield asked.resolve()


def with_peers(
    keep: Path | None, pairs: Iterable[Pair], alone: bool = False
) -> Iterator[tuple[Pair, dict[str, xr.Dataset]]]:
    """Each pair with the vectors (px; attribute `cpu_s`) of our runs and of every peer.

    `keep`: folder for pairs and peers' results. What the peers say of errors goes to this command's
    own stderr.
    """
    with kept_or_temporary(keep) as folder:
        jobs = []
        for pair in pairs:
            a, b = pair.images
            np.savez(folder / f"{pair.name}.pair.npz", a=a, b=b)
            if not jobs:
                correlate_pair(a, b)  # compiles
            found = {label: timed(a, b, **options) for label, options in pair.runs.items()}
            if alone:
                yield pair, found
            else:
                jobs.append((pair, found))
        if alone:
            return
        script = Path(__file__).with_name("peers.py")
        subprocess.run(
            [peer_python(), script, folder], cwd=folder, check=True, stdout=subprocess.DEVNULL
        )
        for pair, found in jobs:
            yield pair, found | peers_vectors(folder / f"{pair.name}.peers.npz")


def compared(keep: Path | None, pairs: Iterable[Pair]) -> dict[str, dict[str, list[Errors]]]:
    """Errors of each pair by method and row; our own runs come first."""
    results: dict = {}
    for pair, found in with_peers(keep, pairs):
        add(results, pair, found)
    return results


def add(
    results: dict[str, dict[str, list[Errors]]], pair: Pair, found: dict[str, xr.Dataset]
) -> None:
    """Append a pair's errors of every method."""
    for name, ds in found.items():
        for row, (flow, counts) in pair.rows.items():
            results.setdefault(name, {}).setdefault(row, []).append(
                judged(ds, flow, counts, found.values())
            )


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
            found[str(r[f"{k}_name"])] = xr.Dataset(
                {"u": (("y", "x"), u), "v": (("y", "x"), v)},
                {"x": x, "y": y},
                {"cpu_s": float(r[f"{k}_t"])},
            )
    return found
